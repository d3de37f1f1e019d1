"""Which Gaussians a task view grounds: the frustum rule of the paper (3.4)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, Int32
from pydantic import BaseModel, ConfigDict, Field

from pipeline.geometry import Camera, points_in_frustum
from pipeline.geometry.frustum import DEFAULT_FAR_M, DEFAULT_NEAR_M
from pipeline.metrics.volume import Weighting


class GroundingConfig(BaseModel):
    """The frustum and how its result is scored (paper 3.4; supplement B.4)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    near_m: float = Field(default=DEFAULT_NEAR_M, gt=0, description="Near plane of the frustum, metres.")
    far_m: float = Field(default=DEFAULT_FAR_M, gt=0, description="Far plane of the frustum, metres.")
    weighting: Weighting = Field(
        default="percentile", description="Weights of the IoU: the paper's, or LightGaussian's."
    )


def frustum_region(
    camera: Camera, activated: Int[np.ndarray, "n"], means: Float[np.ndarray, "M 3"], config: GroundingConfig
) -> Int32[np.ndarray, "_"]:
    """Return the activated Gaussians whose centres lie in a task view's frustum, sorted; no occlusion test.

    Args:
        camera: Task view.
        activated: G_act, sorted.
        means: Centres of all Gaussians, metres.
        config: Clipping planes.
    """
    inside = points_in_frustum(camera, means[activated], near_m=config.near_m, far_m=config.far_m)
    return activated[inside].astype(np.int32)
