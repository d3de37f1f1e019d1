"""All surfaces of an apartment in one struct of arrays, their sizes, and the sample grid each one gets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pipeline.scene.procedural.cells import line_counts
from pipeline.scene.procedural.paint import Paint
from pipeline.scene.procedural.shape import Kind, Shape, surface_bounds
from schemas.errors import InputError

MIN_PER_OBJECT = 50
"""Samples wanted on the smallest thing: fewer and a cup is no longer a solid at arm's length."""
FINEST, COARSEST = 0.36, 1.15
"""Bounds of an object's spacing relative to that of a 1 m object; in between it grows as a power of its size."""
GROWTH = 0.42
"""That power: a cup a tenth of a table's size is sampled 2.6 times finer than the table."""
STRUCTURE = 1.8
"""Spacing of floors, walls and ceilings, on the same scale: they are large, flat and nearly even."""
MAX_GRID = 60_000
"""Most samples along one side of a surface: keeps a near-zero spacing from overflowing."""


@dataclass(frozen=True, slots=True)
class Surfaces:
    """S surfaces of B objects, in object order."""

    kind: Int[np.ndarray, "S"]
    """`Kind` of each surface."""
    frame: Float[np.ndarray, "S 4 3"]
    """Frame rows in the object's own frame, metres."""
    taper: Float[np.ndarray, "S 2"]
    """Radius factors at base and tip (cones), or inner and outer (discs)."""
    joins: Bool[np.ndarray, "S 4"]
    """Which ends of the grid another surface continues."""
    detail: Float[np.ndarray, "S"]
    """Spacing relative to what the object's size asks for."""
    paint: Int[np.ndarray, "S"]
    """Index into `paints`."""
    owner: Int[np.ndarray, "S"]
    """Object of each surface, ascending."""
    paints: tuple[Paint, ...]
    """Distinct finishes."""


def collect(shapes: Sequence[Shape]) -> Surfaces:
    """Return the surfaces of all shapes; shape i owns the surfaces with owner i."""
    numbers: dict[Paint, int] = {}
    paint = [numbers.setdefault(p, len(numbers)) for shape in shapes for p in shape.paints]
    return Surfaces(
        kind=np.array([kind for shape in shapes for kind in shape.kinds], np.int64),
        frame=np.stack([frame for shape in shapes for frame in shape.frames]),
        taper=np.array([taper for shape in shapes for taper in shape.tapers], np.float64),
        joins=np.array([joins for shape in shapes for joins in shape.joins], bool),
        detail=np.array([detail for shape in shapes for detail in shape.details], np.float64),
        paint=np.array(paint, np.int64),
        owner=np.repeat(np.arange(len(shapes)), [len(shape.kinds) for shape in shapes]),
        paints=tuple(numbers),
    )


def side_lengths(surfaces: Surfaces) -> Float[np.ndarray, "S 2"]:
    """Return the lengths (m) along both grid directions; discs and balls give the sides of an equal square."""
    f, norm = surfaces.frame, np.linalg.norm
    sides = np.stack(
        [
            (norm(f[:, 1] - f[:, 0], axis=1) + norm(f[:, 3] - f[:, 2], axis=1)) / 2,
            (norm(f[:, 2] - f[:, 0], axis=1) + norm(f[:, 3] - f[:, 1], axis=1)) / 2,
        ],
        axis=1,
    )
    u, w, a = (norm(f[:, i], axis=1) for i in (1, 2, 3))
    cone, disc, ball = (surfaces.kind == kind for kind in (Kind.CONE, Kind.DISC, Kind.BALL))
    slant = np.hypot(a, u * (surfaces.taper[:, 1] - surfaces.taper[:, 0]))
    sides[cone] = np.stack([np.pi * (u + w) * surfaces.taper.mean(axis=1), slant], axis=1)[cone]
    sides[disc] = np.sqrt(np.pi * u * w * (1 - surfaces.taper[:, 0] ** 2))[disc, None]
    # Thomsen's formula for the area of an ellipsoid, good to 1 %.
    p = 1.6075
    area = 4 * np.pi * (((u * w) ** p + (u * a) ** p + (w * a) ** p) / 3) ** (1 / p)
    sides[ball] = np.sqrt(area)[ball, None]
    return sides


def relative_spacing(surfaces: Surfaces, structure: Bool[np.ndarray, "B"]) -> Float[np.ndarray, "S"]:
    """Return each surface's spacing relative to that of a 1 m object: smaller things are sampled finer.

    Args:
        surfaces: All surfaces.
        structure: Which objects are floors, walls or ceilings.
    """
    starts = np.flatnonzero(np.diff(surfaces.owner, prepend=-1))
    stops = np.append(starts[1:], len(surfaces.owner))
    sizes = []
    for start, stop in zip(starts, stops, strict=True):
        low, high = surface_bounds(surfaces.kind[start:stop], surfaces.frame[start:stop], surfaces.taper[start:stop])
        sizes.append(float((high - low).max()))
    factor = np.where(structure, STRUCTURE, (np.array(sizes) ** GROWTH).clip(FINEST, COARSEST))
    return np.repeat(factor, stops - starts)


def grids(
    surfaces: Surfaces, sides: Float[np.ndarray, "S 2"], spacing: Float[np.ndarray, "S"]
) -> Int[np.ndarray, "S 2"]:
    """Return the samples along both directions of every surface, at least 1 x 1; discs and balls are n x 1."""
    steps = sides / spacing[:, None]
    counts = np.stack([line_counts(steps[:, k], surfaces.joins[:, 2 * k : 2 * k + 2]) for k in (0, 1)], axis=1)
    cone, round_ = surfaces.kind == Kind.CONE, surfaces.kind >= Kind.DISC
    # Six discs around a rod is the least that looks round and stays closed.
    counts[cone, 0] = np.maximum(np.ceil(steps[cone, 0]), 6)
    least = np.where(surfaces.kind == Kind.BALL, 24, 5)
    counts[round_, 0] = np.maximum(np.ceil(steps[round_, 0] ** 2), least[round_])
    counts[round_, 1] = 1
    return counts.clip(1, MAX_GRID**2).astype(np.int64)


def choose_grids(
    surfaces: Surfaces, target: int, structure: Bool[np.ndarray, "B"]
) -> tuple[Int[np.ndarray, "S 2"], Float[np.ndarray, "S"]]:
    """Return the grids whose total comes closest to `target` samples, and the spacing (m) of each surface.

    Args:
        surfaces: All surfaces.
        target: Samples wanted.
        structure: Which objects are floors, walls or ceilings.

    Raises:
        InputError: Even the sparsest grids need more than `target`.
    """
    sides, factor = side_lengths(surfaces), relative_spacing(surfaces, structure)
    area = sides.prod(axis=1)
    object_area = np.bincount(surfaces.owner, area)[surfaces.owner]
    most = np.sqrt(object_area / MIN_PER_OBJECT)

    def attempt(base_m: float, floor: float) -> tuple[Int[np.ndarray, "S 2"], Float[np.ndarray, "S"], float]:
        spacing = np.minimum(base_m * factor, most * floor) * surfaces.detail
        counts = grids(surfaces, sides, spacing)
        return counts, spacing, float(counts.prod(axis=1).sum())

    # Scenes under about 30k cannot afford the wished-for minimum per object: it is then relaxed step by step.
    for floor in (1.0, 1.4, 2.0, 3.0, 100.0):
        if attempt(1.0, floor)[2] <= target:
            break
    else:
        least = int(attempt(1.0, 100.0)[2])
        raise InputError("apartment", field="gaussians", expected=f"at least {least} for its contents", found=target)
    low, high = 1e-4, 1.0
    for _ in range(40):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if attempt(middle, floor)[2] > target else (low, middle)
    counts, spacing, _ = attempt(high, floor)
    return counts, spacing
