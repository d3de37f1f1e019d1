"""What is known of each Gaussian's meaning: a category, an embedding, and (ground truth only) an instance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int32

from schemas.errors import InputError

UNLABELLED = -1
"""Category or instance of a Gaussian nothing is known of; ignored, never background."""


@dataclass(frozen=True, slots=True)
class Semantics:
    """Per-Gaussian meaning, in the order of the scene's Gaussians.

    Raises:
        InputError: Lengths differ, a category id is outside the vocabulary, or the vocabulary repeats a name.
    """

    vocabulary: tuple[str, ...]
    """Category names C; `category` indexes it."""
    category: Int32[np.ndarray, "M"] | None = None
    """Closed-set category id per Gaussian, -1 unlabelled; None when the scene has embeddings only."""
    embedding: Float[np.ndarray, "M D"] | None = None
    """Open-set feature per Gaussian, float16 or float32, unit norm; an all-zero row is unlabelled."""
    instance: Int32[np.ndarray, "M"] | None = None
    """Ground-truth instance id per Gaussian, -1 unlabelled. Read by metrics only, never by the method."""

    def __post_init__(self) -> None:
        lengths = {
            name: len(array)
            for name in ("category", "embedding", "instance")
            if (array := getattr(self, name)) is not None
        }
        if len(set(lengths.values())) > 1:
            raise InputError("semantics", expected="one row per Gaussian in every column", found=lengths)
        if len(set(self.vocabulary)) != len(self.vocabulary):
            raise InputError("semantics", field="vocabulary", expected="distinct names", found="a repeated name")
        if self.category is not None and len(self.category):
            low, high = int(self.category.min()), int(self.category.max())
            if low < UNLABELLED or high >= len(self.vocabulary):
                raise InputError(
                    "semantics",
                    field="category",
                    expected=f"ids from -1 to {len(self.vocabulary) - 1}",
                    found=f"{low} to {high}",
                )

    def __len__(self) -> int:
        for array in (self.category, self.embedding, self.instance):
            if array is not None:
                return len(array)
        return 0

    @property
    def labelled_share(self) -> float:
        """Share of Gaussians with a category or an embedding, 0 to 1."""
        known = np.zeros(len(self), bool)
        if self.category is not None:
            known |= self.category != UNLABELLED
        if self.embedding is not None:
            known |= (self.embedding != 0).any(axis=1)
        return float(known.mean()) if len(known) else 0.0

    def present(self) -> tuple[str, ...]:
        """Return the sorted names of categories that at least one Gaussian carries."""
        if self.category is None:
            return ()
        ids = np.unique(self.category)
        return tuple(sorted(self.vocabulary[i] for i in ids if i >= 0))
