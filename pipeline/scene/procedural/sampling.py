"""Surfaces to points: positions, tangents and normals of every sample, chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pipeline.scene.procedural.cells import HALF_OPACITY, line_cells
from pipeline.scene.procedural.shape import Kind
from pipeline.scene.procedural.surfaces import Surfaces

CHUNK = 1 << 17
"""Samples worked on at once: keeps the float64 temporaries of 5M Gaussians under 100 MB."""
JITTER = 0.1
"""Standard deviation of a sample's shift along the surface, in spacings: breaks the grid, leaves it closed."""
GOLDEN = np.pi * (3 - np.sqrt(5))
"""Angle of the sunflower and sphere spirals, radians."""


@dataclass(frozen=True, slots=True)
class Samples:
    """n samples in their objects' own frames."""

    surface: Int[np.ndarray, "n"]
    """Surface of each sample."""
    point: Float[np.ndarray, "n 3"]
    """Position, metres."""
    step_u: Float[np.ndarray, "n 3"]
    """Vector to the next sample along u, metres."""
    step_v: Float[np.ndarray, "n 3"]
    """Vector to the next sample along v, metres."""
    normal: Float[np.ndarray, "n 3"]
    """Unit outward normal."""


def sample(surfaces: Surfaces, counts: Int[np.ndarray, "S 2"], rng: np.random.Generator) -> Iterator[Samples]:
    """Yield the samples of all surfaces in order, in chunks that hold whole surfaces."""
    totals = counts.prod(axis=1)
    ends = np.cumsum(totals)
    start = 0
    while start < len(totals):
        before = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, before + CHUNK, side="right")), start + 1)
        yield _sample_range(surfaces, counts, start, stop, rng)
        start = stop


def _sample_range(
    surfaces: Surfaces, counts: Int[np.ndarray, "S 2"], start: int, stop: int, rng: np.random.Generator
) -> Samples:
    totals = counts[start:stop].prod(axis=1)
    surface = np.repeat(np.arange(start, stop), totals)
    local = np.arange(len(surface)) - np.repeat(np.cumsum(totals) - totals, totals)
    shift = rng.normal(0.0, JITTER, (len(surface), 2)).clip(-0.25, 0.25)
    n = len(surface)
    point, step_u, step_v, normal = (np.empty((n, 3)) for _ in range(4))
    for kind, place in ((Kind.QUAD, _quad), (Kind.CONE, _cone), (Kind.DISC, _disc), (Kind.BALL, _ball)):
        rows = np.flatnonzero(surfaces.kind[surface] == kind)
        if len(rows):
            s = surface[rows]
            parts = place(
                Rows(surfaces.frame[s], surfaces.taper[s], surfaces.joins[s], counts[s], local[rows], shift[rows])
            )
            point[rows], step_u[rows], step_v[rows], normal[rows] = parts
    return Samples(surface, point, step_u, step_v, normal)


def _drawn_in(step: np.ndarray) -> np.ndarray:
    """Radius factor that keeps flat discs, `step` radians wide, from standing out at a round thing's silhouette."""
    return 1.0 / np.sqrt(1.0 + (0.8 * HALF_OPACITY * step) ** 2)


@dataclass(frozen=True, slots=True)
class Rows:
    """What placing n samples of one kind of surface needs."""

    frame: Float[np.ndarray, "n 4 3"]
    """Frame of each sample's surface."""
    taper: Float[np.ndarray, "n 2"]
    """Radius factors of the surface."""
    joins: Bool[np.ndarray, "n 4"]
    """Joined ends of the surface."""
    counts: Int[np.ndarray, "n 2"]
    """Grid of the surface."""
    local: Int[np.ndarray, "n"]
    """Number of the sample in its surface."""
    shift: Float[np.ndarray, "n 2"]
    """Shift along both grid directions, in cells."""


Parts = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def _quad(rows: Rows) -> Parts:
    """Bilinear patch."""
    counts, local, shift = rows.counts, rows.local, rows.shift
    u, step_u = line_cells(counts[:, 0], local % counts[:, 0], shift[:, 0], rows.joins[:, :2])
    v, step_v = line_cells(counts[:, 1], local // counts[:, 0], shift[:, 1], rows.joins[:, 2:])
    u, v, step_u, step_v = (x[:, None] for x in (u, v, step_u, step_v))
    p00, p10, p01, p11 = (rows.frame[:, i] for i in range(4))
    along_u = (p10 - p00) * (1 - v) + (p11 - p01) * v
    along_v = (p01 - p00) * (1 - u) + (p11 - p10) * u
    point = p00 * (1 - u) * (1 - v) + p10 * u * (1 - v) + p01 * (1 - u) * v + p11 * u * v
    return point, along_u * step_u, along_v * step_v, _unit(np.cross(along_u, along_v))


def _cone(rows: Rows) -> Parts:
    """Side of a truncated cone; every other ring is turned by half a spacing."""
    counts, shift, taper = rows.counts, rows.shift, rows.taper
    ring = rows.local // counts[:, 0]
    angle = 2 * np.pi * (rows.local % counts[:, 0] + 0.5 * (ring % 2) + shift[:, 0]) / counts[:, 0]
    t, step = line_cells(counts[:, 1], ring, shift[:, 1], rows.joins[:, 2:])
    t, step = t[:, None], step[:, None]
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    base, u, w, axis = (rows.frame[:, i] for i in range(4))
    radius = (taper[:, :1] + (taper[:, 1:] - taper[:, :1]) * t) * _drawn_in(2 * np.pi / counts[:, :1])
    around = radius * (cos * w - sin * u)
    outward = cos * u + sin * w
    along = axis + (taper[:, 1:] - taper[:, :1]) * outward
    point = base + t * axis + radius * outward
    # A cone that ends in a point has no width there; its discs keep a quarter of the base's.
    around *= np.maximum(1.0, 0.25 / np.maximum(radius, 1e-6))
    return point, around * (2 * np.pi / counts[:, :1]), along * step, _unit(np.cross(around, along))


def _disc(rows: Rows) -> Parts:
    """Sunflower spiral, drawn in so that half opacity falls on the rim; rings leave their middle out."""
    n, inner = rows.counts[:, 0], rows.taper[:, 0]
    spacing = np.sqrt(np.pi * (1 - inner**2) / n)
    rim = (1 - 0.4 * spacing).clip(0.4)
    hole = np.minimum(inner + 0.4 * spacing * (inner > 0), rim)
    radius = np.sqrt(hole**2 + (rim**2 - hole**2) * (rows.local + 0.5) / n)
    angle = GOLDEN * rows.local
    base, u, w, normal = (rows.frame[:, i] for i in range(4))
    point = base + (radius * np.cos(angle))[:, None] * u + (radius * np.sin(angle))[:, None] * w
    return point, u * spacing[:, None], w * spacing[:, None], _unit(normal)


def _ball(rows: Rows) -> Parts:
    """Spherical spiral stretched to the ellipsoid."""
    n = rows.counts[:, 0]
    height = 1 - 2 * (rows.local + 0.5) / n
    ring = np.sqrt(1 - height**2)
    angle = GOLDEN * rows.local + rows.shift[:, 0]
    cos, sin, spacing = np.cos(angle), np.sin(angle), np.sqrt(4 * np.pi / n)
    base, u, w, axis = (rows.frame[:, i] for i in range(4))

    def spread(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return x[:, None] * u + y[:, None] * w + z[:, None] * axis

    inner = _drawn_in(spacing)[:, None]
    east = spread(-sin, cos, np.zeros(len(n))) * spacing[:, None] * inner
    north = spread(-cos * height, -sin * height, ring) * spacing[:, None] * inner
    return base + inner * spread(ring * cos, ring * sin, height), east, north, _unit(np.cross(east, north))
