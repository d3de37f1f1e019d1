"""A scene in memory: what the query stages read. Loading and checking one lives in `load.py` and `check.py`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from pipeline.scene.gaussians import Gaussians
from pipeline.scene.semantics import Semantics
from pipeline.scene.text_embeddings import TextEmbeddings
from pipeline.scene.views import View
from schemas.errors import InputError


@dataclass(frozen=True, slots=True)
class Scene:
    """M Gaussians, N recorded views and what is known of their meaning.

    Raises:
        InputError: Semantics and Gaussians differ in length, or two views share a name.
    """

    name: str
    """Name unique in a run; rows and paths carry it."""
    gaussians: Gaussians
    """The M Gaussians."""
    views: tuple[View, ...]
    """The N recorded views."""
    semantics: Semantics
    """Category, embedding and instance per Gaussian."""
    up: Float[np.ndarray, "3"] = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    """Unit vector opposite to gravity, world frame."""
    texts: TextEmbeddings | None = None
    """Text embeddings of the features' model; None where the scene brings none."""
    warnings: tuple[str, ...] = ()
    """What loading dropped or assumed, one line each."""

    def __post_init__(self) -> None:
        if len(self.semantics) not in (0, len(self.gaussians)):
            raise InputError(
                self.name, field="semantics", expected=f"{len(self.gaussians)} rows", found=len(self.semantics)
            )
        names = [view.name for view in self.views]
        if len(set(names)) != len(names):
            raise InputError(self.name, field="views", expected="distinct names", found="a repeated name")
