"""Product quantisation of embeddings: a byte for every few numbers (Jegou et al. 2011), for scenes too large otherwise.

A vector is cut into parts; each part is stored as the number of the nearest of 256 typical ones, found by k-means.
512 float16 numbers take 1,024 bytes; with 128 parts, 128.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, UInt8

from schemas.errors import InputError

CODES = 256
"""Typical parts: what a byte can name."""
ROUNDS = 12
"""Of k-means; the error changes by under a percent beyond."""
LEARN_FROM = 20_000
"""Vectors k-means looks at, drawn at random: 80 for each code."""
ROWS_AT_ONCE = 1 << 14


@dataclass(frozen=True, slots=True)
class Codebooks:
    """The typical parts."""

    parts: Float32[np.ndarray, "S C w"]
    """Of each of S parts, C of them, at most 256."""


def learn_codebooks(vectors: Float[np.ndarray, "M D"], parts: int, rng: np.random.Generator) -> Codebooks:
    """Return codebooks learnt from vectors.

    Args:
        vectors: At least one; rows of zeros are left out.
        parts: Parts S a vector is cut into; divides D.
        rng: Draws the vectors to learn from and k-means' first centres.

    Raises:
        InputError: `parts` does not divide D, or no vector is usable.
    """
    from scipy.cluster.vq import kmeans2

    width, rest = divmod(vectors.shape[1], parts) if parts > 0 else (0, 1)
    if rest or not width:
        raise InputError("quantisation", field="parts", expected=f"a divisor of {vectors.shape[1]}", found=parts)
    usable = np.flatnonzero((vectors != 0).any(axis=1))
    if not len(usable):
        raise InputError("quantisation", field="vectors", expected="one that is not zero", found="none")
    drawn = np.sort(rng.choice(usable, min(LEARN_FROM, len(usable)), replace=False))
    sample = np.asarray(vectors[drawn], np.float32)
    books = []
    for part in range(parts):
        rows = np.unique(sample[:, part * width : (part + 1) * width], axis=0)
        if len(rows) > CODES:
            start = rows[rng.choice(len(rows), CODES, replace=False)]
            with warnings.catch_warnings():
                # A code nothing is nearest to stays where it was: a wasted code, no wrong one.
                warnings.filterwarnings("ignore", message="One of the clusters is empty", category=UserWarning)
                rows, _ = kmeans2(sample[:, part * width : (part + 1) * width], start, iter=ROUNDS, minit="matrix")
        books.append(np.concatenate([rows, np.repeat(rows[:1], CODES - len(rows), axis=0)]))
    return Codebooks(np.stack(books).astype(np.float32))


def encode(vectors: Float[np.ndarray, "M D"], books: Codebooks) -> UInt8[np.ndarray, "M S"]:
    """Return the nearest typical part of each part of each vector, the lower number of those equally near."""
    from scipy.cluster.vq import vq

    parts, _, width = books.parts.shape
    if vectors.shape[1] != parts * width:
        raise InputError("quantisation", field="vectors", expected=f"size {parts * width}", found=vectors.shape[1])
    codes = np.empty((len(vectors), parts), np.uint8)
    for start in range(0, len(vectors), ROWS_AT_ONCE):
        rows = np.asarray(vectors[start : start + ROWS_AT_ONCE], np.float32)
        for part in range(parts):
            codes[start : start + len(rows), part] = vq(rows[:, part * width : (part + 1) * width], books.parts[part])[
                0
            ]
    return codes


def decode(codes: UInt8[np.ndarray, "M S"], books: Codebooks) -> Float32[np.ndarray, "M D"]:
    """Return the vectors that codes stand for."""
    parts, known, width = books.parts.shape
    if codes.shape[1] != parts or (len(codes) and codes.max() >= known):
        raise InputError("quantisation", field="codes", expected=f"{parts} numbers under {known}", found=codes.shape)
    out = np.empty((len(codes), parts * width), np.float32)
    for part in range(parts):
        out[:, part * width : (part + 1) * width] = books.parts[part][codes[:, part]]
    return out
