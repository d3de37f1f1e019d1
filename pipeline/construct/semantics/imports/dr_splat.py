"""Dr. Splat: features in its checkpoint, or product-quantised codes with the codebooks exported beside it."""

from __future__ import annotations

import numpy as np

from pipeline.construct.semantics.imports.features import ImportedFeatures, read_npz
from pipeline.construct.semantics.language_checkpoint import read_language_checkpoint
from pipeline.construct.semantics.quantise import Codebooks, decode
from schemas.errors import InputError

INVALID = 255
"""All bytes of a Gaussian without a feature."""


def read_dr_splat(checkpoint: str, codebooks: str = "") -> ImportedFeatures:
    """Return the features of a Dr. Splat checkpoint.

    Args:
        checkpoint: `chkpnt0.pth` with features, or with the codes of a faiss index IVF + PQ: the cell's number in as
            many low-order-first bytes as it needs, then a byte a part.
        codebooks: NPZ file with `cells` (L, D), the index's coarse centroids, and `parts` (S, 256, D / S), its
            product quantiser's; both are a line each with faiss. Needed for codes.

    Raises:
        InputError: A file is wrong, or the checkpoint holds codes and there are no codebooks.
    """
    found = read_language_checkpoint(checkpoint, codes=bool(codebooks))
    if found.features.dtype != np.uint8:
        return ImportedFeatures(found.features, (found.features != 0).any(axis=1), found.means, checkpoint)
    arrays = read_npz(codebooks, {"cells": "f", "parts": "f"})
    cells, parts = arrays["cells"], arrays["parts"]
    if cells.ndim != 2 or parts.ndim != 3 or parts.shape[1] != 256 or parts.shape[0] * parts.shape[2] != cells.shape[1]:
        expected = "cells (L, D) and parts (S, 256, D / S)"
        raise InputError(codebooks, expected=expected, found=f"{cells.shape} and {parts.shape}")
    codes = found.features
    head = -(-(len(cells) - 1).bit_length() // 8)
    if codes.shape[1] != head + len(parts):
        expected = f"codes of {head + len(parts)} bytes, as these codebooks have"
        raise InputError(checkpoint, expected=expected, found=codes.shape[1])
    valid = (codes != INVALID).any(axis=1)
    cell = (codes[:, :head].astype(np.int64) << (8 * np.arange(head))).sum(axis=1)
    if (cell[valid] >= len(cells)).any():
        raise InputError(checkpoint, expected=f"cells under {len(cells)}", found=int(cell[valid].max()))
    features = np.zeros((len(codes), cells.shape[1]), np.float32)
    residual = decode(codes[valid, head:], Codebooks(parts.astype(np.float32)))
    features[valid] = cells[cell[valid]] + residual
    return ImportedFeatures(features, valid, found.means, checkpoint)
