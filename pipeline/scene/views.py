"""The recorded views of a scene: N cameras with names and, where the capture is at hand, image files."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.geometry import Camera


@dataclass(frozen=True, slots=True)
class View:
    """One recorded view H_i."""

    name: str
    """Name unique in its scene, stable across loads: the frame's file stem or its number."""
    camera: Camera
    """Lens and pose."""
    image: str | None = None
    """Path or URI of the photograph; None when only the pose is at hand."""
    depth: str | None = None
    """Path or URI of the depth image; None when there is none."""
