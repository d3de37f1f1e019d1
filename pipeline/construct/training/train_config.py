"""What training is told: how long, what it lowers, how fast, and which skips it may take. Imports no torch."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class LearningRates(BaseModel):
    """Adam's steps; one is taken per image that shows a Gaussian.

    3DGS takes 30,000 steps; these are made for some hundreds to a few thousand, from a start that depth gave.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    means: float = Field(default=8e-4, gt=0, description="Positions at the start, in extents of the camera path.")
    means_last: float = Field(default=8e-5, gt=0, description="Positions at the end; log-linear between.")
    quats: float = Field(default=5e-3, ge=0, description="Rotations.")
    log_scales: float = Field(default=2e-2, ge=0, description="Logarithms of the scales.")
    opacity_logits: float = Field(default=0.1, ge=0, description="Opacities before the sigmoid.")
    colors: float = Field(default=2e-2, ge=0, description="Colours of degree 0.")
    directions: float = Field(default=1e-3, ge=0, description="Higher degrees: how colour depends on direction.")
    exposures: float = Field(default=1e-2, ge=0, description="Gain and offset of a photograph, where they are fitted.")
    poses: float = Field(default=1e-3, ge=0, description="A photograph's pose, metres and radians, where it is fitted.")
    last_share: float = Field(
        default=0.1, gt=0, le=1, description="Of all rates but those of positions, what is left at the end; log-linear."
    )


class DensityConfig(BaseModel):
    """When Gaussians are cloned, split and pruned; 3DGS's defaults but for `growth`, its steps as shares of the run.

    Off by default: a start from depth has its Gaussians. One from sparse points needs rounds, every 50 steps or so.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    every: int = Field(default=0, ge=0, description="Steps between two rounds; 0 leaves the Gaussians as they are.")
    first: float = Field(default=0.02, ge=0, le=1, description="Share of the run before the first round.")
    last: float = Field(default=0.5, ge=0, le=1, description="Share of the run after which there are no more rounds.")
    gradient: float = Field(
        default=2e-4, gt=0, description="Mean pull at the projected centre (image from -1 to 1) from which to densify."
    )
    dense_extent: float = Field(
        default=0.01, gt=0, description="Gaussians up to this scale are cloned, larger ones split; in extents."
    )
    growth: float = Field(
        default=0.2, gt=0, le=1, description="Share by which a round may add Gaussians; the strongest pulls come first."
    )
    most: int = Field(default=1_000_000, ge=1, description="Gaussians there may be; the strongest pulls come first.")
    least_opacity: float = Field(default=0.005, ge=0, lt=1, description="Fainter Gaussians are pruned.")
    largest_extent: float = Field(
        default=0.5, gt=0, description="Larger Gaussians are pruned; in extents. 3DGS's 0.1 is 10 cm in a small room."
    )
    reset_every: int = Field(
        default=0,
        ge=0,
        description="Steps between two cuts of all opacities to `reset_to`, while rounds last; 0: none.",
    )
    reset_to: float = Field(default=0.01, gt=0, lt=1, description="What opacities are cut to.")


class TrainConfig(BaseModel):
    """One capture's optimisation."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    steps: int = Field(default=500, ge=0, description="Images looked at; 0 leaves the start as it is.")
    minutes: float | None = Field(
        default=None,
        gt=0,
        description="Minutes of training after which it ends, if it has not before; schedules follow whichever of "
        "steps and minutes is nearer its end. With it, results depend on how fast the machine is.",
    )
    dssim_weight: float = Field(default=0.2, ge=0, le=1, description="Share of D-SSIM in the colour loss; L1 the rest.")
    depth_first: float = Field(
        default=1.0, ge=0, description="Weight of the inverse-depth loss at the start; 0 leaves it out."
    )
    depth_last: float = Field(
        default=0.1,
        gt=0,
        description="Its weight at the end; log-linear between. 0.01, made for depth that a network guessed, lets "
        "surfaces drift off measured depth; 1 costs colour.",
    )
    rates: LearningRates = Field(default=LearningRates(), description="Learning rates.")
    beta2: float = Field(default=0.999, gt=0, lt=1, description="Memory of Adam's squared gradients.")
    density: DensityConfig = Field(default=DensityConfig(), description="Cloning, splitting and pruning.")
    sh_degree: int = Field(default=1, ge=0, le=3, description="Degree of spherical harmonics at the end.")
    sh_every: float = Field(default=0.3, ge=0, le=1, description="Share of the run between two raises of the degree.")
    scales: tuple[tuple[float, float], ...] = Field(
        default=((0.0, 0.5), (0.8, 1.0)),
        description="Image scale (0 to 1) from a share of the run on, in pairs (share, scale): coarse to fine.",
    )
    image_side: int = Field(
        default=1024, ge=16, description="Photographs whose longer side has more pixels are scaled down to it."
    )
    exposure: bool = Field(default=False, description="Fit a gain and an offset per photograph and channel.")
    refine_poses: bool = Field(
        default=False,
        description="Fit each photograph's pose: for captures whose photographs are out of step with them.",
    )
    tile_error_floor: float = Field(
        default=0.0,
        ge=0,
        description="Tiles of 16 x 16 pixels whose mean absolute error (colours of 0 to 1) is lower have no gradient; "
        "0 keeps every tile.",
    )
    seed: int = Field(default=0, ge=0, description="Draws the order of frames.")
    threads: int = Field(default=1, ge=1, description="Threads; no number of them changes a result.")
    device: Literal["cpu", "cuda"] = Field(default="cpu", description="cuda needs the gsplat package and a GPU.")
    checkpoint_steps: int = Field(default=200, ge=1, description="Steps between two checkpoints.")
    report_steps: int = Field(default=50, ge=1, description="Steps between two reports of progress.")
    evaluate_steps: int = Field(
        default=0, ge=0, description="Steps between two looks at the held-out frames; 0: at the end alone."
    )

    @model_validator(mode="after")
    def _scales_rise(self) -> TrainConfig:
        starts = [start for start, _ in self.scales]
        if not starts or starts[0] != 0.0 or starts != sorted(set(starts)) or starts[-1] >= 1:
            raise ValueError("scales: shares of the run must rise from 0 and stay below 1")
        if not all(0.0 < scale <= 1.0 for _, scale in self.scales):
            raise ValueError("scales: image scales must be above 0 and at most 1")
        return self
