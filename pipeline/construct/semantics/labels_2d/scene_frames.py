"""Frames whose photographs or depth are renders of the Gaussians: for scenes without photographs, and without depth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, UInt8

from pipeline.construct.simulated.procedural_frames import SEEN_ALPHA
from pipeline.geometry import Camera
from pipeline.render import PreparedGaussians, color_image, prepare, render
from pipeline.scene import Gaussians, View
from pipeline.scene.captures import Frame


def rendered_frames(gaussians: Gaussians | PreparedGaussians, views: Iterable[View]) -> tuple[Frame, ...]:
    """Return frames at the views' poses that show the Gaussians, rendered when they are read and not kept."""
    prepared = gaussians if isinstance(gaussians, PreparedGaussians) else prepare(gaussians)
    return tuple(
        Frame(view.name, view.camera, RenderedImage(prepared, view.camera), RenderedDepth(prepared, view.camera))
        for view in views
    )


def with_rendered_depth(frames: Iterable[Frame], gaussians: Gaussians | PreparedGaussians) -> tuple[Frame, ...]:
    """Return the frames with depth rendered through the photograph's lens in place of a depth camera's.

    Recorded depth has another lens and holes; this one fits photograph and Gaussians pixel by pixel.
    """
    prepared = gaussians if isinstance(gaussians, PreparedGaussians) else prepare(gaussians)
    return tuple(replace(frame, depth=RenderedDepth(prepared, frame.camera), depth_camera=None) for frame in frames)


@dataclass(frozen=True)
class RenderedImage:
    """A photograph of the Gaussians."""

    gaussians: PreparedGaussians
    """The scene."""
    camera: Camera
    """Lens and pose."""

    def read(self) -> UInt8[np.ndarray, "H W 3"]:
        """Return sRGB pixels."""
        return color_image(render(self.gaussians, self.camera, ("color",)))


@dataclass(frozen=True)
class RenderedDepth:
    """A depth image of the Gaussians."""

    gaussians: PreparedGaussians
    """The scene."""
    camera: Camera
    """Lens and pose."""

    def read(self) -> Float32[np.ndarray, "H W"]:
        """Return z-depth in metres, 0 where little is seen."""
        rendering = render(self.gaussians, self.camera, ("depth", "alpha"))
        assert rendering.depth is not None, "it was asked for"
        assert rendering.alpha is not None, "it was asked for"
        return np.where(rendering.alpha >= SEEN_ALPHA, rendering.depth, np.float32(0.0))
