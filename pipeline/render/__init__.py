"""Images of Gaussians on a CPU: colour, depth, alpha, dominant and heaviest Gaussians and labels of every pixel."""

from pipeline.render.api import OUTPUTS, render, render_reference, visible_ids
from pipeline.render.contributors import Contributors, top_contributors, top_contributors_reference
from pipeline.render.counting import BlendCounts, count_blends
from pipeline.render.images import category_image, color_image
from pipeline.render.labels import LabelImage, heaviest_label, label_image, label_weights, label_weights_reference
from pipeline.render.many import render_many
from pipeline.render.prepare import PreparedGaussians, nearby, prepare
from pipeline.render.quality import EXACT, FAST, PRESETS, RenderQuality
from pipeline.render.rendering import Rendering

__all__ = [
    "EXACT",
    "FAST",
    "OUTPUTS",
    "PRESETS",
    "BlendCounts",
    "Contributors",
    "LabelImage",
    "PreparedGaussians",
    "RenderQuality",
    "Rendering",
    "category_image",
    "color_image",
    "count_blends",
    "heaviest_label",
    "label_image",
    "label_weights",
    "label_weights_reference",
    "nearby",
    "prepare",
    "render",
    "render_many",
    "render_reference",
    "top_contributors",
    "top_contributors_reference",
    "visible_ids",
]
