"""Candidate views as a model sees them: rendered pictures, what each observes, and how visible the cluster is there."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from io import BytesIO
from typing import Literal

import numpy as np
from jaxtyping import Int, Int32, UInt8
from pydantic import BaseModel, ConfigDict, Field

from pipeline.geometry import Camera
from pipeline.models.messages import ImagePart, Observation
from pipeline.query.visibility import dominant_ids, fitted_to
from pipeline.render import PreparedGaussians, category_image, color_image, render
from pipeline.scene.scene import Scene
from pipeline.scene.views import View
from schemas import storage
from schemas.errors import InputError

Source = Literal["photo", "render"]

MEGABYTE = 1_000_000


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
    visible: Int32[np.ndarray, "_"]
    """Sorted unique dominant Gaussians of the pose in the full scene."""
    key: tuple[object, ...]
    """Pose, lens and photograph: pictures of equal keys are the same."""

    def visibility(self, cluster: Int[np.ndarray, "_"]) -> float:
        """Return S_vis of a cluster (distinct indices) from here, 0 to 1, by the rule of `VisibilityIndex`."""
        return len(np.intersect1d(self.visible, cluster, assume_unique=True)) / len(cluster)

    @property
    def nbytes(self) -> int:
        """Size of the arrays, bytes."""
        size = self.image.color.nbytes + self.visible.nbytes
        if self.image.observation is not None:
            size += self.image.observation.category.nbytes + self.image.observation.depth.nbytes
        return size


class PictureBook:
    """Renders poses of one scene and keeps the most recently used, so that questions share them.

    Args:
        scene: For categories, up direction and photographs.
        gaussians: Its Gaussians.
        config: Sizes.
    """

    def __init__(self, scene: Scene, gaussians: PreparedGaussians, config: ImageConfig) -> None:
        self._scene, self._gaussians, self._config = scene, gaussians, config
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
        photo = view.image if view is not None and self._config.initial_image == "photo" else None
        key = (camera.world_to_camera.tobytes(), camera.K.tobytes(), camera.width, camera.height, photo)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        picture = self._made(fitted_to(camera, self._config.long_side), photo, key)
        self._keep(key, picture)
        return picture

    def _made(self, camera: Camera, photo: str | None, key: tuple[object, ...]) -> Picture:
        outputs = ("color", "depth", "dominant") if photo is None else ("depth", "dominant")
        image = render(self._gaussians, camera, outputs=outputs, near=self._config.near_m)
        self.renders += 1
        assert image.depth is not None
        assert image.dominant is not None
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
        ids = dominant_ids(image.dominant, len(self._gaussians))
        source: Source = "render" if photo is None else "photo"
        return Picture(ImagePart(color, observation), source, ids, key)

    def _keep(self, key: tuple[object, ...], picture: Picture) -> None:
        limit = self._config.cache_mb * MEGABYTE
        if picture.nbytes > limit:
            return
        self._kept[key] = picture
        self._bytes += picture.nbytes
        while self._bytes > limit:
            _, dropped = self._kept.popitem(last=False)
            self._bytes -= dropped.nbytes


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
