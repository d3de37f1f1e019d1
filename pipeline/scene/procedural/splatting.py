"""Placed things to Gaussians: flat discs on every surface, coloured, lit, and labelled."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from pipeline.geometry import rotations_to_quats
from pipeline.scene.gaussians import SH_COUNTS, Gaussians
from pipeline.scene.procedural.cells import SIGMA
from pipeline.scene.procedural.hiding import STRUCTURE, hidden_discs, visible_shapes
from pipeline.scene.procedural.highlights import to_sh
from pipeline.scene.procedural.light import Light
from pipeline.scene.procedural.sampling import Samples, sample
from pipeline.scene.procedural.surfaces import Surfaces, choose_grids, collect
from pipeline.scene.procedural.texture import brightness
from pipeline.scene.procedural.things import Placed
from pipeline.scene.procedural.vocabulary import CATEGORY_IDS
from pipeline.scene.semantics import Semantics

THICKNESS = 0.06
"""Standard deviation across the surface, relative to along it."""
OPACITY = (0.955, 0.99)
"""Range of opacities."""


def splat(
    things: list[Placed], count: int, vocabulary: tuple[str, ...], sh_degree: int, rng: np.random.Generator
) -> tuple[Gaussians, Semantics]:
    """Return about `count` Gaussians on the surfaces of all things, in their order, with categories and instances.

    Args:
        things: Placed things; a Gaussian's instance is its thing's index.
        count: Gaussians wanted; the result is within a few percent.
        vocabulary: Category names; ids index it.
        sh_degree: 0 to 3.
        rng: Source of jitter.

    Raises:
        InputError: `count` is too small for the things.
    """
    surfaces = collect(visible_shapes(things))
    structure = np.array([thing.model.category in STRUCTURE for thing in things])
    counts, _ = choose_grids(surfaces, count, structure)
    total = int(counts.prod(axis=1).sum())
    pose = np.array([[*thing.at, np.cos(thing.yaw), np.sin(thing.yaw), thing.room] for thing in things])
    floors = np.array([thing.model.category == "floor" for thing in things])
    light = Light.of(things)
    means, scales = np.empty((total, 3), np.float32), np.empty((total, 3), np.float32)
    quats = np.empty((total, 4), np.float32)
    sh = np.empty((total, SH_COUNTS[sh_degree], 3), np.float32)
    owner = np.empty(total, np.int32)
    done = 0
    for chunk in sample(surfaces, counts, rng):
        rows = slice(done, done + len(chunk.surface))
        done = rows.stop
        owner[rows] = surfaces.owner[chunk.surface]
        at = pose[owner[rows]]
        point = _turn(chunk.point, at) + at[:, :3]
        normal = _turn(chunk.normal, at)
        means[rows] = point
        quats[rows], scales[rows], spacing = _discs(_turn(chunk.step_u, at), _turn(chunk.step_v, at), normal)
        color, gloss = _color(
            surfaces, chunk, point, normal, at[:, 5].astype(np.int64), floors[owner[rows]], light, spacing
        )
        sh[rows] = to_sh(color, normal, gloss, sh_degree)
    opacity = rng.uniform(*OPACITY, total).astype(np.float32)
    keep = ~hidden_discs(means, owner, things)
    categories = np.array([CATEGORY_IDS[thing.model.category] for thing in things], np.int32)
    gaussians = Gaussians(means[keep], quats[keep], scales[keep], np.log(opacity / (1 - opacity))[keep], sh[keep])
    return gaussians, Semantics(vocabulary, category=categories[owner[keep]], instance=owner[keep])


def _turn(vector: np.ndarray, pose: np.ndarray) -> np.ndarray:
    c, s = pose[:, 3], pose[:, 4]
    return np.stack([c * vector[:, 0] - s * vector[:, 1], s * vector[:, 0] + c * vector[:, 1], vector[:, 2]], axis=1)


def _discs(
    step_u: Float[np.ndarray, "n 3"], step_v: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "n 3"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation, log scales and mean spacing of discs that fill one grid cell each."""
    length_u = np.maximum(np.linalg.norm(step_u, axis=1), 1e-5)
    first = step_u / length_u[:, None]
    # Gram-Schmidt against the normal keeps the frame orthogonal where the normal of a disc was given, not computed.
    first -= (first * normal).sum(axis=1, keepdims=True) * normal
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-9)
    second = np.cross(normal, first)
    length_v = np.maximum(np.abs((step_v * second).sum(axis=1)), 1e-5)
    quats = rotations_to_quats(np.stack([first, second, normal], axis=2))
    thin = THICKNESS * np.minimum(length_u, length_v)
    scales = np.log(np.stack([SIGMA * length_u, SIGMA * length_v, thin.clip(2e-4, 3e-3)], axis=1))
    return quats, scales, np.sqrt(length_u * length_v)


def _color(
    surfaces: Surfaces,
    chunk: Samples,
    point: np.ndarray,
    normal: np.ndarray,
    room: np.ndarray,
    on_floor: np.ndarray,
    light: Light,
    spacing: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    paints = surfaces.paints
    paint = surfaces.paint[chunk.surface]
    base = np.array([p.color for p in paints])[paint]
    numbers = np.array([[p.texture, p.period_m, p.contrast, p.gloss, p.glow] for p in paints])[paint]
    tone = brightness(numbers[:, 0].astype(np.int64), chunk.point, chunk.normal, numbers[:, 1], numbers[:, 2], spacing)
    lit = light.shade(point, normal, room, on_floor, numbers[:, 4])
    return (base * tone[:, None] * lit).clip(0.0, 1.0), numbers[:, 3]
