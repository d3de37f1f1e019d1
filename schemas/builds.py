"""Table `builds`: what became of each capture that a build run turned into a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from schemas.table import Added, TableSpec

BuildStatus = Literal["built", "failed"]
"""built: the scene lies whole in its folder; failed: `reason` says why it does not."""

BUILD_STATUSES: tuple[BuildStatus, ...] = get_args(BuildStatus)


@dataclass(frozen=True, slots=True)
class BuildRow:
    """One row a capture. Counts are 0 and measures null for a failed one; seconds stand in `timings`."""

    scene: str
    """Name of the scene."""
    capture: str
    """Path of the capture."""
    scene_uri: str
    """Folder of the scene."""
    status: str
    """built or failed."""
    reason: str
    """Error of a failed one, its class first; empty otherwise."""
    start: str
    """What the Gaussians began as: depth (fused) or points (sparse ones)."""
    frames: int
    """Usable frames of the capture."""
    fitted: int
    """Frames the scene was fitted to."""
    held_out: int
    """Frames it was measured on and not fitted to."""
    skipped: int
    """Frames left out: broken or missing poses, empty depth."""
    started: int
    """Gaussians before the optimisation."""
    gaussians: int
    """M, Gaussians of the scene."""
    steps: int
    """Steps of the optimisation, in all sessions."""
    psnr: float | None
    """Mean over held-out photographs, dB; null where there are none."""
    ssim: float | None
    """Mean over held-out photographs, 0 to 1; null where there are none."""
    depth_error_m: float | None
    """Mean absolute error over held-out depth, metres; null where there is none."""
    depth_within_5cm: float | None
    """Share of held-out depth pixels whose error is under 5 cm, 0 to 1; null where there is no depth."""
    labels: str
    """Kind of the source of categories or features; empty without one."""
    categories: int
    """Categories that at least one Gaussian carries."""
    labelled: float
    """Share of Gaussians with a category or a feature, 0 to 1."""
    questions: int
    """Questions copied into the scene's folder."""
    warnings: tuple[str, ...]
    """What was left out, assumed or corrected, one line each."""
    photos_moved: int
    """Fitted photographs that were moved to where the scene says they were taken."""
    aligned_psnr: float | None
    """PSNR, dB, once the pose of each held-out photograph is fitted to the scene; null where `psnr` is."""
    aligned_ssim: float | None
    """SSIM at these poses, 0 to 1; null where `psnr` is."""
    exposed_psnr: float | None
    """PSNR, dB, at these poses after a gain and an offset per channel; null where `psnr` is."""
    objects: int
    """Ground-truth objects copied into the scene's folder."""


BUILDS = TableSpec(
    name="builds",
    version=2,
    record=BuildRow,
    key=("scene",),
    columns={
        "scene": "string",
        "capture": "string",
        "scene_uri": "string",
        "status": "string",
        "reason": "string",
        "start": "string",
        "frames": "int64",
        "fitted": "int64",
        "held_out": "int64",
        "skipped": "int64",
        "started": "int64",
        "gaussians": "int64",
        "steps": "int64",
        "psnr": "float64?",
        "ssim": "float64?",
        "depth_error_m": "float64?",
        "depth_within_5cm": "float64?",
        "labels": "string",
        "categories": "int64",
        "labelled": "float64",
        "questions": "int64",
        "warnings": "list<string>",
        "photos_moved": "int64",
        "aligned_psnr": "float64?",
        "aligned_ssim": "float64?",
        "exposed_psnr": "float64?",
        "objects": "int64",
    },
    added={
        "photos_moved": Added(2, 0),
        "aligned_psnr": Added(2),
        "aligned_ssim": Added(2),
        "exposed_psnr": Added(2),
        "objects": Added(2, 0),
    },
)
