"""A capture in one convention: posed frames whose photographs and depth are read one at a time, when asked for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, UInt8

from pipeline.geometry import Camera
from pipeline.scene.views import View
from schemas.errors import InputError

SkipReason = Literal["broken pose", "no pose", "empty depth"]
"""Why a frame cannot be used."""


@runtime_checkable
class ImageReader(Protocol):
    """Where one photograph lies; small, so that a capture travels between processes."""

    def read(self) -> UInt8[np.ndarray, "H W 3"]:
        """Return sRGB pixels."""
        ...


@runtime_checkable
class DepthReader(Protocol):
    """Where one depth image lies."""

    def read(self) -> Float32[np.ndarray, "h w"]:
        """Return z-depth in metres, 0 where there is none."""
        ...


@runtime_checkable
class PointsReader(Protocol):
    """Where the sparse points of a reconstruction lie."""

    def read(self) -> SparsePoints:
        """Return the points."""
        ...


@dataclass(frozen=True, slots=True)
class SparsePoints:
    """Points a structure-from-motion program found."""

    positions: Float[np.ndarray, "P 3"]
    """World positions, metres where the capture is."""
    colors: UInt8[np.ndarray, "P 3"]
    """sRGB."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One moment of a capture."""

    name: str
    """Name unique in the capture: the file's stem or its number."""
    camera: Camera
    """Lens and pose of the photograph."""
    image: ImageReader | None = None
    """The photograph; None when it is not at hand."""
    depth: DepthReader | None = None
    """The depth image; None when there is none."""
    depth_camera: Camera | None = None
    """Lens and pose of the depth image; None where they are the photograph's."""

    @property
    def image_uri(self) -> str | None:
        """Path or URI of the photograph where it is a file of its own."""
        return getattr(self.image, "uri", None)

    @property
    def depth_uri(self) -> str | None:
        """Path or URI of the depth image where it is a file of its own."""
        return getattr(self.depth, "uri", None)

    @property
    def depth_lens(self) -> Camera:
        """The camera that depth belongs to."""
        return self.depth_camera or self.camera

    def read_image(self) -> UInt8[np.ndarray, "H W 3"]:
        """Return the photograph, of the camera's size.

        Raises:
            InputError: There is none, it cannot be read, or it is of another size.
        """
        if self.image is None:
            raise InputError(f"frame {self.name}", field="image", expected="a photograph", found="none")
        pixels = self.image.read()
        _require_size(self, "image", pixels.shape, self.camera)
        return pixels

    def read_depth(self) -> Float32[np.ndarray, "h w"]:
        """Return z-depth in metres, 0 where there is none, of the depth camera's size.

        Raises:
            InputError: There is none, it cannot be read, or it is of another size.
        """
        if self.depth is None:
            raise InputError(f"frame {self.name}", field="depth", expected="a depth image", found="none")
        depth_m = self.depth.read()
        _require_size(self, "depth", depth_m.shape, self.depth_lens)
        return depth_m


@dataclass(frozen=True, slots=True)
class Skipped:
    """A frame that was left out."""

    name: str
    """Its name."""
    reason: SkipReason
    """Why, in a word that can be counted."""
    detail: str
    """What was found, with the file."""


@dataclass(frozen=True, slots=True)
class Capture:
    """Posed frames of one place.

    Raises:
        InputError: No frame is usable, or two share a name.
    """

    name: str
    """Name of the scene it shows: the folder's or the file's."""
    frames: tuple[Frame, ...]
    """The N usable frames, in the order they were taken."""
    skipped: tuple[Skipped, ...] = ()
    """Frames left out, and why."""
    notes: tuple[str, ...] = ()
    """What was corrected or assumed, one line each."""
    up: Float[np.ndarray, "3"] | None = None
    """Unit vector opposite to gravity; None where the format does not say."""
    points: PointsReader | None = None
    """Sparse points; None where there are none."""

    def __post_init__(self) -> None:
        if not self.frames:
            first = f"; first: {self.skipped[0].detail}" if self.skipped else ""
            found = f"none of {len(self.skipped)}{first}"
            raise InputError(f"capture {self.name}", expected="at least one usable frame", found=found)
        repeated = [name for name, count in Counter(frame.name for frame in self.frames).items() if count > 1]
        if repeated:
            raise InputError(f"capture {self.name}", field="frames", expected="distinct names", found=repeated[0])

    def __len__(self) -> int:
        """Return N."""
        return len(self.frames)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The N cameras of the photographs."""
        return tuple(frame.camera for frame in self.frames)

    @property
    def views(self) -> tuple[View, ...]:
        """The N frames as a scene's recorded views; photographs inside a larger file have no path of their own."""
        return tuple(View(frame.name, frame.camera, frame.image_uri, frame.depth_uri) for frame in self.frames)

    @property
    def skip_counts(self) -> dict[str, int]:
        """How many frames were left out, by reason."""
        return dict(Counter(skip.reason for skip in self.skipped))

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notes, then one line for each reason frames were left out, with its count and the first of them."""
        total = len(self.frames) + len(self.skipped)
        lines = []
        for reason, count in self.skip_counts.items():
            first = next(skip.detail for skip in self.skipped if skip.reason == reason)
            lines.append(f"skipped {count} of {total} frames ({reason}); first: {first}")
        return (*self.notes, *lines)

    def only(self, names: Iterable[str]) -> Capture:
        """Return the capture with these frames alone, in capture order; what was skipped stays on record."""
        wanted = frozenset(names)
        return replace(self, frames=tuple(frame for frame in self.frames if frame.name in wanted))

    def without_empty_depth(
        self, least_share: float = 0.01, *, progress: Callable[[int], object] | None = None
    ) -> Capture:
        """Return the capture without frames whose depth image is blank; every depth image is read once.

        Args:
            least_share: Share of pixels with depth below which an image counts as blank, 0 to 1.
            progress: Called with the number of frames done.
        """
        kept, skipped = [], list(self.skipped)
        for done, frame in enumerate(self.frames, start=1):
            blank = None if frame.depth is None else blank_depth(frame, frame.read_depth(), least_share)
            if blank is None:
                kept.append(frame)
            else:
                skipped.append(blank)
            if progress is not None:
                progress(done)
        return replace(self, frames=tuple(kept), skipped=tuple(skipped))


def blank_depth(frame: Frame, depth_m: Float32[np.ndarray, "h w"], least_share: float = 0.01) -> Skipped | None:
    """Return why the frame is to be left out, or None where at least `least_share` of its pixels have depth."""
    share = float(np.count_nonzero(depth_m)) / depth_m.size
    if share >= least_share:
        return None
    where = frame.depth_uri or f"frame {frame.name}"
    return Skipped(frame.name, "empty depth", f"{where}: {share:.1%} of its pixels have depth")


def _require_size(frame: Frame, field: str, shape: tuple[int, ...], camera: Camera) -> None:
    if shape[:2] != (camera.height, camera.width):
        subject = (frame.image_uri if field == "image" else frame.depth_uri) or f"frame {frame.name}"
        expected = f"{camera.width} x {camera.height} pixels, the camera's"
        raise InputError(subject, field=field, expected=expected, found=f"{shape[1]} x {shape[0]}")
