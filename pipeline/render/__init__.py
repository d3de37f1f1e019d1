"""Images of Gaussians on a CPU: colour, depth, alpha and the dominant Gaussian of every pixel."""

from pipeline.render.api import OUTPUTS, render, render_reference, visible_ids
from pipeline.render.images import category_image, color_image
from pipeline.render.prepare import PreparedGaussians, prepare
from pipeline.render.rendering import Rendering

__all__ = [
    "OUTPUTS",
    "PreparedGaussians",
    "Rendering",
    "category_image",
    "color_image",
    "prepare",
    "render",
    "render_reference",
    "visible_ids",
]
