"""Candidate views as a model sees them: rendered pictures, what each observes, and how visible the cluster is there."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Literal

import numpy as np
from jaxtyping import UInt8
from pydantic import BaseModel, ConfigDict, Field

from pipeline.geometry import Camera
from pipeline.models.messages import ImagePart, Observation
from pipeline.query.view_quality import Footprint, footprint
from pipeline.query.visibility import fitted_to
from pipeline.render import PreparedGaussians, Rendering, category_image, color_image, render_many
from pipeline.scene.scene import Scene
from pipeline.scene.views import View
from schemas import storage
from schemas.errors import InputError

Source = Literal["photo", "render"]

MEGABYTE = 1_000_000
_READ = ("depth", "alpha", "dominant")


class ImageConfig(BaseModel):
    """What the model is shown (paper 3.4: task poses are rendered)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    long_side: int = Field(
        default=512, ge=16, description="Longest image side, pixels; views recorded smaller keep their size."
    )
    initial_image: Source = Field(
        default="render",
        description="render: an initial view is rendered like the others. photo: its photograph where there is one.",
    )
    near_m: float = Field(default=0.2, gt=0, description="Near plane, metres.")
    cache_mb: int = Field(default=256, ge=0, description="Pictures kept for later questions on the scene, megabytes.")


@dataclass(frozen=True, slots=True)
class Picture:
    """One rendered pose."""

    image: ImagePart
    """Colours, and what the symbolic model may read."""
    source: Source
    """Where its colours come from."""
    footprint: Footprint
    """Dominant Gaussians of the pose in the full scene, and where they show."""
    key: tuple[object, ...]
    """Pose, lens and photograph: pictures of equal keys are the same."""

    @property
    def nbytes(self) -> int:
        """Size of the arrays, bytes."""
        size = self.image.color.nbytes + self.footprint.nbytes
        if self.image.observation is not None:
            size += self.image.observation.category.nbytes + self.image.observation.depth.nbytes
        return size


class PictureBook:
    """Renders poses of one scene and keeps the most recently used, so that questions share them.

    Args:
        scene: For categories, up direction and photographs.
        gaussians: Its Gaussians.
        config: Sizes.
        threads: Pictures rendered side by side; more than 1 pays where one question alone is under way.
    """

    def __init__(self, scene: Scene, gaussians: PreparedGaussians, config: ImageConfig, threads: int = 1) -> None:
        self._scene, self._gaussians, self._config, self._threads = scene, gaussians, config, threads
        self._kept: OrderedDict[tuple[object, ...], Picture] = OrderedDict()
        self._bytes = 0
        self.renders = 0
        """Pictures rendered so far."""

    def render(self, camera: Camera, view: View | None = None) -> Picture:
        """Return the picture of a pose.

        Args:
            camera: Lens at its recorded size, and pose.
            view: The recorded view when the pose is its own: then its photograph may be shown.

        Raises:
            InputError: The photograph cannot be read.
        """
        return self.render_all([camera], [view])[0]

    def render_all(self, cameras: Sequence[Camera], views: Sequence[View | None]) -> tuple[Picture, ...]:
        """Return the pictures of several poses; arguments are those of `render`, one each a pose.

        Raises:
            InputError: A photograph cannot be read.
        """
        shots = [self._shot(camera, view) for camera, view in zip(cameras, views, strict=True)]
        known = {shot.key: self._kept[shot.key] for shot in shots if shot.key in self._kept}
        missing = list({shot.key: shot for shot in shots if shot.key not in known}.values())
        for made in self._made(missing):
            known[made.key] = made
        for shot in shots:
            self._keep(known[shot.key])
        return tuple(known[shot.key] for shot in shots)

    def _shot(self, camera: Camera, view: View | None) -> _Shot:
        photo = view.image if view is not None and self._config.initial_image == "photo" else None
        key = (camera.world_to_camera.tobytes(), camera.K.tobytes(), camera.width, camera.height, photo)
        return _Shot(fitted_to(camera, self._config.long_side), photo, key)

    def _made(self, shots: Sequence[_Shot]) -> Iterator[Picture]:
        # Colours cost half a render, so those that a photograph brings are not rendered.
        for photographed, outputs in ((False, ("color", *_READ)), (True, _READ)):
            chosen = [shot for shot in shots if (shot.photo is not None) == photographed]
            cameras = [shot.camera for shot in chosen]
            images = render_many(
                self._gaussians,
                cameras,
                outputs,
                near=self._config.near_m,
                threads=min(self._threads, len(chosen) or 1),
            )
            for shot, image in zip(chosen, images, strict=True):
                self.renders += 1
                yield self._picture(shot, image)

    def _picture(self, shot: _Shot, image: Rendering) -> Picture:
        assert image.depth is not None
        assert image.alpha is not None
        assert image.dominant is not None
        camera, photo = shot.camera, shot.photo
        color = color_image(image) if photo is None else read_photo(photo, camera.width, camera.height)
        semantics, observation = self._scene.semantics, None
        if semantics.category is not None:
            observation = Observation(
                category=category_image(image.dominant, semantics.category),
                depth=image.depth,
                K=np.asarray(camera.K),
                up=camera.world_to_camera[:, :3] @ self._scene.up,
                vocabulary=semantics.vocabulary,
            )
        shown = footprint(image.dominant, image.alpha, len(self._gaussians))
        source: Source = "render" if photo is None else "photo"
        return Picture(ImagePart(color, observation), source, shown, shot.key)

    def _keep(self, picture: Picture) -> None:
        """Put a picture in the last place, and drop those in the first places while there are too many."""
        limit = self._config.cache_mb * MEGABYTE
        if picture.key in self._kept:
            self._kept.move_to_end(picture.key)
            return
        if picture.nbytes > limit:
            return
        self._kept[picture.key] = picture
        self._bytes += picture.nbytes
        while self._bytes > limit:
            _, dropped = self._kept.popitem(last=False)
            self._bytes -= dropped.nbytes


@dataclass(frozen=True, slots=True)
class _Shot:
    """A picture to be taken."""

    camera: Camera
    photo: str | None
    key: tuple[object, ...]


def read_photo(uri: str, width: int, height: int) -> UInt8[np.ndarray, "H W 3"]:
    """Return a photograph as sRGB pixels of the given size.

    Raises:
        InputError: It is missing or is not an image.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(storage.read_bytes(uri))) as opened:
            shrunk = opened.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
    except (UnidentifiedImageError, OSError) as error:
        raise InputError(uri, expected="an image file", found=error) from error
    return np.asarray(shrunk, np.uint8)
