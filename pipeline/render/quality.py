"""How much a frame may give up for speed: every lossy choice of the renderer as one named number."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32
from pydantic import BaseModel, ConfigDict, Field

from pipeline.geometry import Camera

ALPHA_MIN = 1.0 / 255.0
"""The reference rasteriser drops smaller contributions."""


class RenderQuality(BaseModel):
    """The lossy knobs of a frame. As constructed without arguments, nothing is lost (`EXACT`)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scale: float = Field(
        default=1.0,
        gt=0,
        le=1,
        description="Rendered width and height as a share of the camera's; images are enlarged afterwards "
        "(colour and alpha bilinearly, depth and dominant Gaussian by the nearest pixel).",
    )
    sh_degree: int = Field(default=3, ge=0, le=3, description="Highest spherical-harmonics degree used.")
    min_opacity: float = Field(default=0.0, ge=0, le=1, description="Gaussians less opaque than this are left out.")
    alpha_min: float = Field(
        default=ALPHA_MIN,
        ge=ALPHA_MIN,
        lt=0.99,
        description="Contributions below this alpha are dropped: a larger one shrinks every footprint.",
    )
    transmittance_stop: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="A pixel ends once its transmittance has fallen below this; the Gaussian that did it is kept. "
        "What is lost weighs less than this number. At 0 only the reference's own stop, 1e-4, holds.",
    )

    def camera(self, camera: Camera) -> Camera:
        """Return the camera that is really rendered; the same object at scale 1."""
        width, height = (max(1, round(side * self.scale)) for side in (camera.width, camera.height))
        return camera if (width, height) == (camera.width, camera.height) else camera.resized(width, height)

    def limits(self) -> Float32[np.ndarray, "2"]:
        """Return log2 of the smallest alpha, and by how much log2 of a Gaussian's opacity must exceed it."""
        log2_alpha = np.log2(self.alpha_min)
        least = max(0.0, float(np.log2(self.min_opacity) - log2_alpha)) if self.min_opacity > 0 else 0.0
        return np.array([log2_alpha, least], np.float32)


EXACT = RenderQuality()
"""The reference semantics, nothing given up."""
FAST = RenderQuality(alpha_min=4.0 / 255.0, transmittance_stop=1e-2)
"""44 to 46 dB against `EXACT` for 0.5 to 0.8 of a colour frame's time; the same dominant Gaussian on 99 % of the pixels
(benchmarks/error_vs_time.py). Scale, degree and pruning stay exact: they lose more for the time they save."""
PRESETS = {"exact": EXACT, "fast": FAST}
"""Presets by the name a configuration gives."""
