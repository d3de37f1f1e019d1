"""How a capture becomes a scene: the settings of every step, composed. Imports no torch."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.fusion.fuse_config import FusionConfig
from pipeline.construct.semantics.describe import SemanticsConfig
from pipeline.construct.training.train_config import TrainConfig


class BuildConfig(BaseModel):
    """From a capture to a scene. All of it shapes the scene, so that it is part of a unit's id."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    frames: int | None = Field(
        None, ge=1, description="frames to fit the scene to, chosen for coverage and sharpness; null takes all"
    )
    hold_out: int | None = Field(
        10,
        ge=2,
        description="of every so many frames the last is kept from fitting, and the scene is measured on it; null fits "
        "to all and measures nothing",
    )
    most_held_out: int = Field(50, ge=1, description="held-out frames that are measured, spread evenly")
    start: Literal["auto", "depth", "points"] = Field(
        "auto", description="what the Gaussians begin as: fused depth, or sparse points; auto takes depth where it is"
    )
    fusion: FusionConfig = Field(default_factory=FusionConfig, description="how depth becomes Gaussians")
    register_photos: Literal["auto", "on", "off"] = Field(
        "auto",
        description="whether each photograph is put where the fused scene says it was taken, and depth is fused again: "
        "for captures whose poses are those of a depth camera out of step with the photographs; auto tries it on a "
        "run of frames and does so where photographs left out of it fit better",
    )
    train: TrainConfig = Field(default_factory=TrainConfig, description="the optimisation; steps: 0 leaves it out")
    densify_points_every: int = Field(
        50,
        ge=0,
        description="train.density.every of a capture that starts from sparse points and has 0 there: fused depth "
        "covers its surfaces, points do not",
    )
    semantics: SemanticsConfig = Field(
        default_factory=SemanticsConfig, description="what names the Gaussians; without a source no question finds any"
    )
