"""Features from elsewhere, and their place in a scene: the Gaussians' own centres prove the order."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float16, Float32

from pipeline.scene import Gaussians
from schemas import storage
from schemas.errors import InputError

SAME_M = 1e-3
"""Centres may differ by this much, metres: files round."""
ROWS_AT_ONCE = 1 << 16
"""Rows normalised at a time."""


@dataclass(frozen=True, slots=True)
class ImportedFeatures:
    """What a file says of M Gaussians.

    Raises:
        InputError: Rows do not match, or a valid one is not finite.
    """

    features: Float[np.ndarray, "M D"]
    """Features of any norm; rows that are not valid are not read."""
    valid: Bool[np.ndarray, "M"]
    """Gaussians that have one."""
    means: Float32[np.ndarray, "M 3"] | None
    """Their centres; None where the file has none."""
    source: str
    """The file, for the scene's record."""

    def __post_init__(self) -> None:
        for name in ("features", "means"):
            rows = getattr(self, name)
            if rows is not None and len(rows) != len(self.valid):
                raise InputError(self.source, field=name, expected=f"{len(self.valid)} rows", found=len(rows))
        bad = self.valid & ~np.isfinite(self.features).all(axis=1)
        if bad.any():
            found = f"{int(bad.sum())} rows with others"
            raise InputError(self.source, field="features", expected="finite numbers where valid", found=found)

    def embedding(self, gaussians: Gaussians) -> Float16[np.ndarray, "M D"]:
        """Return unit features for a scene's Gaussians, zero where there is none.

        Raises:
            InputError: The scene has another number of Gaussians, or others.
        """
        if len(gaussians) != len(self.valid):
            expected = f"{len(gaussians)} Gaussians, as in the scene"
            raise InputError(self.source, expected=expected, found=len(self.valid))
        if self.means is not None and not np.allclose(self.means, gaussians.means, rtol=0, atol=SAME_M):
            raise InputError(self.source, expected="the scene's Gaussians in their order", found="other centres")
        out = np.zeros(self.features.shape, np.float16)
        for start in range(0, len(out), ROWS_AT_ONCE):
            rows = slice(start, start + ROWS_AT_ONCE)
            block = self.features[rows].astype(np.float32)
            norms = np.linalg.norm(block, axis=1)
            usable = self.valid[rows] & (norms > 0)
            out[rows][usable] = block[usable] / norms[usable, None]
        return out


def read_npz(uri: str, wanted: dict[str, str]) -> dict[str, np.ndarray]:
    """Return arrays of an NPZ file; pickled objects are refused.

    Args:
        uri: The file.
        wanted: Names that must be there, and the letters of the numpy kinds each may be of.

    Raises:
        InputError: The file is missing or no such NPZ.
    """
    expected = "an NPZ file with " + ", ".join(wanted)
    try:
        with np.load(io.BytesIO(storage.read_bytes(uri)), allow_pickle=False) as file:
            arrays = {name: file[name] for name in wanted}
    except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(uri, expected=expected, found=str(error)) from error
    for name, kinds in wanted.items():
        if arrays[name].dtype.kind not in kinds:
            raise InputError(uri, field=name, expected=expected, found=arrays[name].dtype)
    return arrays
