"""What depth fusion may be told."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class FusionConfig(BaseModel):
    """How finely a capture with depth becomes Gaussians, and what it takes for a point to be believed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    voxel_m: float = Field(
        default=0.01,
        gt=0,
        le=1,
        description="Edge of a voxel, metres: a surface gets one Gaussian in each voxel it passes through.",
    )
    farthest_m: float = Field(
        default=8.0, gt=0, allow_inf_nan=False, description="Depth beyond this is not used, metres."
    )
    least_frames: int = Field(
        default=2,
        ge=1,
        description="Frames whose depth must agree on a point; 1 where there is one frame.",
    )
    fill: bool = Field(
        default=True,
        description="Close what photographs show and no depth reaches (glass, screens, dark things) with wide "
        "Gaussians at a depth guessed from the surroundings.",
    )
    color_rounds: int = Field(
        default=1, ge=0, description="Times the colours are fitted to the photographs through the renderer."
    )
    threads: int = Field(default=1, ge=1, description="Threads; no number of them changes a result.")
