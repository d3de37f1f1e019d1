"""Features out of a Dr. Splat or LangSplat checkpoint, read without running anything that the file brings.

Torch is asked for tensors and plain values only; a file that needs more is refused.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from schemas import storage
from schemas.errors import InputError

FIELDS = 13
"""Entries of the model's tuple in the checkpoint; LangSplat's and Dr. Splat's have the same."""
XYZ, FEATURES = 1, 7
"""Of these, the centres and the language features."""
_NOT_READ = (
    *(pickle.UnpicklingError, RuntimeError, OSError, EOFError),
    *(LookupError, ValueError, TypeError, AttributeError),
)
"""How torch's reader ends on files it refuses, and on bytes that are no pickle at all."""
EXPECTED = "a checkpoint (model, iteration) with 13 entries in model, features as M x D floats in the eighth"


@dataclass(frozen=True, slots=True)
class LanguageCheckpoint:
    """What a checkpoint says of its Gaussians."""

    means: Float32[np.ndarray, "M 3"]
    """Their centres."""
    features: Float32[np.ndarray, "M D"] | UInt8[np.ndarray, "M D"]
    """Their language features, of any norm, all zero for none; quantised codes where these were asked for."""


def read_language_checkpoint(uri: str, *, codes: bool = False) -> LanguageCheckpoint:
    """Return the centres and features of a Dr. Splat `chkpnt0.pth`, or of another in its form.

    Args:
        uri: A local file.
        codes: Take product-quantised codes as they are; else they are refused.

    Raises:
        InputError: Torch is not installed, the file is not local, is no such checkpoint, holds anything but tensors
            and plain values, or holds product-quantised codes instead of features.
    """
    loaded = load_tensors(uri)
    model = loaded[0] if isinstance(loaded, tuple | list) and len(loaded) == 2 else None
    if not isinstance(model, tuple | list) or len(model) != FIELDS:
        raise InputError(uri, expected=EXPECTED, found=type(loaded).__name__)
    xyz, features = model[XYZ], model[FEATURES]
    if not all(hasattr(one, "detach") and one.ndim == 2 for one in (xyz, features)):
        raise InputError(uri, expected=EXPECTED, found="no tensor of two axes there")
    means, rows = xyz.detach().float().numpy(), features.detach()
    quantised = str(rows.dtype) == "torch.uint8"
    if quantised and not codes:
        raise InputError(
            uri, expected="features; decode the codes with their index and export them to NPZ", found="quantised codes"
        )
    if not (quantised or rows.is_floating_point()) or len(rows) != len(means):
        raise InputError(uri, expected=EXPECTED, found=f"{rows.dtype}, {tuple(rows.shape)}")
    return LanguageCheckpoint(means, rows.numpy() if quantised else rows.float().numpy())


def load_tensors(uri: str) -> Any:
    """Return what a local torch file holds, if that is tensors and plain values alone.

    Raises:
        InputError: Torch is not installed, the file is not local, or it holds anything else.
    """
    path = storage.local_path(uri)
    if path is None:
        raise InputError(uri, expected="a local checkpoint, or features exported to NPZ", found="a remote one")
    try:
        import torch
    except ImportError as error:
        raise InputError(uri, expected="torch to be installed, or features exported to NPZ", found="none") from error
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except _NOT_READ as error:
        first = str(error).strip().splitlines()
        found = first[0] if first else type(error).__name__
        raise InputError(
            uri, expected="tensors and plain values alone; export the features to NPZ otherwise", found=found
        ) from error
