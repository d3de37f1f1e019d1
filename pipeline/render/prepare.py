"""What can be computed once per scene: covariance axes, log-opacities, a spatial order and the bounds of its blocks.

Gaussians are put in Morton order, so that 128 neighbours in memory are neighbours in space and a view can drop
whole blocks before it looks at single Gaussians. Colours stay where they are: only survivors' are read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64, UInt64

from pipeline.geometry import quats_to_rotations
from pipeline.scene.gaussians import Gaussians

BLOCK = 128
"""Gaussians per culling block: smaller blocks cull more, larger ones cost less to test; 64 to 256 differ by 2 %."""
GROUP = 8
"""Gaussians that lie side by side in `geometry`: the width of a vector register."""
ROWS = 13
"""Numbers per Gaussian in `geometry`: mean (3), axes (9), log2 of the opacity."""
LARGEST_DEVIATION_M = 1e9
"""Standard deviations are cut here, by the reference too, so that squares of projected axes stay within float32. An
image can tell only from a mean that is farther away still, or an axis within 1e-9 of the line of sight."""
LOG2_SMALLEST_ALPHA = -np.log2(255.0)
"""Below this opacity a Gaussian can never pass the 1/255 test."""
EXTENT = 3.33
"""Standard deviations after which alpha is below 1/255, whatever the opacity."""
_CHUNK = 1 << 18
"""Gaussians whose float64 intermediates are held at a time."""
_MORTON_BITS = 21
"""Bits per axis of a Morton code; three fit in 63 bits, fine enough that one far outlier does not blur a room."""


@dataclass(frozen=True, slots=True)
class PreparedGaussians:
    """M Gaussians ready to render from any camera; the P of them that can ever be seen, in spatial order."""

    geometry: Float32[np.ndarray, "G 13 8"]
    """Mean (metres), axes (columns of R S, metres) and log2 opacity, in groups of eight; padded to whole blocks."""
    ids: Int32[np.ndarray, "P"]
    """Index in the scene of each Gaussian of `geometry`; -1 in the padding."""
    block_centers: Float64[np.ndarray, "B 3"]
    """Centre of the box around the means of each block, metres."""
    block_halves: Float64[np.ndarray, "B 3"]
    """Half the size of that box, metres."""
    block_reach: Float64[np.ndarray, "B"]
    """Largest standard deviation in each block, metres."""
    sh: Float32[np.ndarray, "M K 3"]
    """Spherical harmonics of all M Gaussians, in scene order."""

    def __len__(self) -> int:
        return len(self.sh)

    @property
    def sh_degree(self) -> int:
        """Degree of the stored spherical harmonics, 0 to 3."""
        return int(np.sqrt(self.sh.shape[1])) - 1


def prepare(gaussians: Gaussians) -> PreparedGaussians:
    """Return what every view of the scene needs, computed once; all arrays are read-only."""
    log2_opacity = log2_sigmoid(gaussians.opacity_logits)
    kept = np.flatnonzero(log2_opacity >= LOG2_SMALLEST_ALPHA - 1e-6)
    order = kept[np.argsort(_morton_codes(gaussians.means[kept]), kind="stable")]
    count = len(order)
    padded = -(-count // BLOCK) * BLOCK
    rows = np.concatenate([order, np.full(padded - count, order[-1] if count else 0, order.dtype)])

    flat = np.empty((padded // GROUP, ROWS, GROUP), np.float32)
    deviations = np.empty(padded)
    for start in range(0, padded, _CHUNK):
        part = rows[start : start + _CHUNK]
        scales = np.minimum(np.exp(gaussians.log_scales[part].astype(np.float64)), LARGEST_DEVIATION_M)
        axes = quats_to_rotations(gaussians.quats[part]) * scales[:, None, :]
        groups = flat[start // GROUP : (start + len(part)) // GROUP]
        groups[:, :3] = _grouped(gaussians.means[part])
        groups[:, 3:12] = _grouped(np.swapaxes(axes, 1, 2).reshape(-1, 9))
        groups[:, 12] = log2_opacity[part].reshape(-1, GROUP)
        deviations[start : start + len(part)] = scales.max(axis=1)
    ids = rows.astype(np.int32)
    ids[count:] = -1
    padding = np.arange(count, padded)
    flat[padding // GROUP, 12, padding % GROUP] = -np.inf

    means = gaussians.means[rows].astype(np.float64).reshape(-1, BLOCK, 3)
    low, high = means.min(axis=1), means.max(axis=1)
    prepared = PreparedGaussians(
        geometry=flat,
        ids=ids,
        block_centers=(low + high) / 2,
        block_halves=(high - low) / 2,
        block_reach=deviations.reshape(-1, BLOCK).max(axis=1),
        sh=gaussians.sh,
    )
    for array in (prepared.geometry, prepared.ids, prepared.block_centers, prepared.block_halves, prepared.block_reach):
        array.setflags(write=False)
    return prepared


def take_rows(prepared: PreparedGaussians, rows: Int64[np.ndarray, "n"]) -> PreparedGaussians:
    """Return some Gaussians of a prepared scene, with the bits they have there; ids are still those of the scene.

    Args:
        prepared: The scene.
        rows: Their places among the P prepared ones, rising.
    """
    count = len(rows)
    padding = np.arange(count, -(-count // BLOCK) * BLOCK)
    rows = np.concatenate([rows, np.full(len(padding), rows[-1] if count else 0, rows.dtype)])
    fields = prepared.geometry[rows // GROUP, :, rows % GROUP]
    geometry = np.ascontiguousarray(_grouped(fields))
    geometry[padding // GROUP, 12, padding % GROUP] = -np.inf
    ids = prepared.ids[rows]
    ids[count:] = -1
    means = fields[:, :3].astype(np.float64).reshape(-1, BLOCK, 3)
    low, high = means.min(axis=1), means.max(axis=1)
    return replace(
        prepared,
        geometry=geometry,
        ids=ids,
        block_centers=(low + high) / 2,
        block_halves=(high - low) / 2,
        block_reach=prepared.block_reach[rows.reshape(-1, BLOCK) // BLOCK].max(axis=1),
    )


def nearby(prepared: PreparedGaussians, point: Float64[np.ndarray, "3"], distance_m: float) -> PreparedGaussians:
    """Return the Gaussians that reach within a distance of a point: up to `EXTENT` standard deviations count.

    Args:
        prepared: The scene.
        point: World frame, metres.
        distance_m: Metres.
    """
    gaps = np.maximum(np.abs(prepared.block_centers - point) - prepared.block_halves, 0.0)
    near = np.flatnonzero(np.linalg.norm(gaps, axis=1) <= distance_m + EXTENT * prepared.block_reach)
    rows = (near[:, None] * BLOCK + np.arange(BLOCK)).reshape(-1)
    rows = rows[prepared.ids[rows] >= 0]
    fields = prepared.geometry[rows // GROUP, :, rows % GROUP].astype(np.float64)
    deviations = np.linalg.norm(fields[:, 3:12].reshape(-1, 3, 3), axis=2).max(axis=1, initial=0.0)
    return take_rows(prepared, rows[np.linalg.norm(fields[:, :3] - point, axis=1) <= distance_m + EXTENT * deviations])


def log2_sigmoid(logits: Float32[np.ndarray, "M"]) -> Float64[np.ndarray, "M"]:
    """Return log2 of the opacities, in float64; exact at plus and minus infinity and accurate far below 1."""
    with np.errstate(over="ignore"):
        return -np.logaddexp(0.0, -logits.astype(np.float64)) / np.log(2.0)


def _grouped(values: Float32[np.ndarray, "n c"] | Float64[np.ndarray, "n c"]) -> np.ndarray:
    return values.reshape(-1, GROUP, values.shape[1]).swapaxes(1, 2)


def _morton_codes(means: Float32[np.ndarray, "n 3"]) -> UInt64[np.ndarray, "n"] | Int64[np.ndarray, "n"]:
    """Return the place of each point on a space-filling curve through the points' bounding box."""
    if len(means) == 0:
        return np.empty(0, np.uint64)
    points = means.astype(np.float64)
    low = points.min(axis=0)
    size = max(float((points.max(axis=0) - low).max()), np.finfo(np.float64).tiny)
    cells = np.minimum((points - low) / size * 2**_MORTON_BITS, 2**_MORTON_BITS - 1).astype(np.uint64)
    code = np.zeros(len(means), np.uint64)
    for axis in range(3):
        code |= _spread(cells[:, axis]) << np.uint64(axis)
    return code


def _spread(x: UInt64[np.ndarray, "n"]) -> UInt64[np.ndarray, "n"]:
    """Return 21-bit numbers with two zero bits after every bit."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x
