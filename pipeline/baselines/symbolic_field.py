"""A stand-in for a language field where a scene has labels alone: no features were learned, and rows say so.

Every category has a direction of its own. A text lies between the categories that it names, as a sentence's embedding
lies between its nouns; one that names none has a direction that no category has.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from pipeline.models.symbolic.tagging import tag

STAND_IN = "symbolic field"
"""Its name in rows."""


def category_features(vocabulary: Sequence[str]) -> Float32[np.ndarray, "C D"]:
    """Return the feature of every category, D = C + 1."""
    return np.eye(len(vocabulary), len(vocabulary) + 1, dtype=np.float32)


class NamedIn:
    """Turns a text into the mean direction of the categories it names.

    Args:
        vocabulary: Category names.
    """

    def __init__(self, vocabulary: tuple[str, ...]) -> None:
        self._vocabulary = vocabulary

    def encode(self, texts: Sequence[str]) -> Float32[np.ndarray, "T D"]:
        """Return one vector a text, of length 1."""
        return np.stack([self._vector(text) for text in texts])

    def _vector(self, text: str) -> Float32[np.ndarray, "D"]:
        names = (
            {text} if text in self._vocabulary else {n for token in tag(text, self._vocabulary) for n in token.exact}
        )
        vector = np.zeros(len(self._vocabulary) + 1, np.float32)
        vector[[self._vocabulary.index(name) for name in names] or [-1]] = 1.0
        return vector / np.linalg.norm(vector)
