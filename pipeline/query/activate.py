"""Gaussian search: which Gaussians each evidence category activates (G_act, paper 3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int32
from pydantic import BaseModel, ConfigDict, Field

from pipeline.scene.semantics import Semantics
from schemas.errors import InputError

ROWS_AT_ONCE = 65_536
"""Embeddings compared in one product: 128 MB of float32 at D = 512, whatever M is."""


class ActivationConfig(BaseModel):
    """How a category finds its Gaussians (paper 3.1)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    by: Literal["labels", "cosine", "relevancy"] = Field(
        default="labels",
        description="labels: the stored category of each Gaussian (paper, EM-EQA). cosine: similarity of its embedding "
        "to the category's text embedding, at least `threshold` (paper, grounding). relevancy: LERF relevancy against "
        "the canonical phrases, above `threshold` (Dr. Splat's code; raw CLIP cosines rarely reach 0.5).",
    )
    threshold: float = Field(default=0.5, ge=-1.0, le=1.0, description="tau of the paper, for cosine and relevancy.")
    canonical: tuple[str, ...] = Field(
        default=("object", "things", "stuff", "texture"),
        min_length=1,
        description="Phrases a category has to beat (relevancy).",
    )
    temperature: float = Field(
        default=10.0, gt=0, description="Factor on both similarities in the softmax (relevancy)."
    )


@runtime_checkable
class TextEncoder(Protocol):
    """Turns category names into embeddings of the scene's feature space; a scene may bring its own as a file."""

    def encode(self, texts: Sequence[str]) -> Float[np.ndarray, "T D"]:
        """Return one embedding per text, any non-zero norm."""
        ...


@dataclass(frozen=True, slots=True)
class Activation:
    """The Gaussians of one evidence category."""

    category: str
    """Category name."""
    ids: Int32[np.ndarray, "n"]
    """Sorted indices into the scene's Gaussians."""


def activate(
    semantics: Semantics, category: str, config: ActivationConfig, encoder: TextEncoder | None = None
) -> Activation:
    """Return the Gaussians that a category activates.

    Args:
        semantics: The scene's.
        category: Evidence category.
        config: Labels, cosine or relevancy.
        encoder: Needed for cosine and relevancy, unused for labels.

    Raises:
        InputError: The scene lacks what `config.by` reads, its vocabulary lacks the category, or there is no encoder.
    """
    if config.by == "labels":
        return Activation(category, ids_with_label(semantics, category))
    if semantics.embedding is None:
        raise InputError("semantics", field="embedding", expected="one per Gaussian", found="none")
    if encoder is None:
        raise InputError(
            "activation", field="by", expected=f"text_embeddings.npz in the scene for {config.by!r}", found="none"
        )
    text = encoder.encode([category, *(config.canonical if config.by == "relevancy" else ())])
    similarity = cosine_similarity(semantics.embedding, text)
    if config.by == "cosine":
        active = similarity[:, 0] >= config.threshold
    else:
        active = relevancy(similarity[:, 0], similarity[:, 1:], config.temperature) > config.threshold
    # An all-zero row is an unlabelled Gaussian; its relevancy of exactly 0.5 says nothing.
    active &= np.asarray(semantics.embedding != 0).any(axis=1)
    return Activation(category, np.flatnonzero(active).astype(np.int32))


def ids_with_label(semantics: Semantics, category: str) -> Int32[np.ndarray, "n"]:
    """Return the sorted indices of Gaussians that carry a category name.

    Raises:
        InputError: The scene has no labels or the name is not in its vocabulary.
    """
    if semantics.category is None:
        raise InputError("semantics", field="category", expected="one per Gaussian", found="none")
    if category not in semantics.vocabulary:
        raise InputError("semantics", field="vocabulary", expected=f"the name {category!r}", found="no such category")
    return np.flatnonzero(semantics.category == semantics.vocabulary.index(category)).astype(np.int32)


def cosine_similarity(embedding: Float[np.ndarray, "M D"], text: Float[np.ndarray, "T E"]) -> Float[np.ndarray, "M T"]:
    """Return the cosine between every Gaussian's feature and every text, float32; 0 for all-zero features.

    Raises:
        InputError: The two have different sizes D.
    """
    if embedding.shape[1] != text.shape[1]:
        raise InputError(
            "text encoder", field="embedding", expected=f"size {embedding.shape[1]}", found=f"size {text.shape[1]}"
        )
    directions = np.asarray(text, np.float32)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    out = np.empty((len(embedding), len(text)), np.float32)
    for start in range(0, len(embedding), ROWS_AT_ONCE):
        rows = np.asarray(embedding[start : start + ROWS_AT_ONCE], np.float32)
        norms = np.linalg.norm(rows, axis=1, keepdims=True)
        out[start : start + ROWS_AT_ONCE] = (rows @ directions.T) / np.where(norms == 0, 1.0, norms)
    return out


def relevancy(
    positive: Float[np.ndarray, "M"], canonical: Float[np.ndarray, "M T"], temperature: float
) -> Float[np.ndarray, "M"]:
    """Return the LERF relevancy, 0 to 1: the least probability of the category against any one canonical phrase."""
    # A softmax over two is a sigmoid of the difference, and the hardest phrase is the most similar one.
    margin = temperature * (positive.astype(np.float64) - canonical.max(axis=1))
    return np.exp(-np.logaddexp(0.0, -margin))
