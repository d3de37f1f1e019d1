"""Scenes: Gaussians, recorded views and semantics, and the formats they come in."""

from pipeline.scene.gaussians import Gaussians
from pipeline.scene.scene import Scene
from pipeline.scene.semantics import UNLABELLED, Semantics
from pipeline.scene.views import View

__all__ = ["UNLABELLED", "Gaussians", "Scene", "Semantics", "View"]
