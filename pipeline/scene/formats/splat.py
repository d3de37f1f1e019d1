"""`.splat` (antimatter15): 32 bytes a Gaussian and nothing else, so its name is the only sign of it."""

from __future__ import annotations

import numpy as np

from pipeline.scene.formats.raw import SH_C0, RawGaussians, logits_of_bytes
from schemas.errors import InputError

ROW = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("quat", "u1", 4)])


def read_splat(data: bytes, subject: object) -> RawGaussians:
    """Return the Gaussians of a .splat file.

    Raises:
        InputError: The length is no multiple of 32 bytes.
    """
    if len(data) % ROW.itemsize:
        raise InputError(subject, expected="a multiple of 32 bytes", found=f"{len(data)} bytes")
    rows = np.frombuffer(data, ROW)
    # A scale of 0 is a flat axis (-inf); a negative one is no number and its Gaussian is dropped.
    log_scales = np.log(rows["scale"])
    color = (rows["rgba"][:, :3].astype(np.float32) / 255 - np.float32(0.5)) / np.float32(SH_C0)
    quats = (rows["quat"].astype(np.float32) - 128) / 128
    return RawGaussians(rows["mean"].copy(), quats, log_scales, logits_of_bytes(rows["rgba"][:, 3]), color[:, None])
