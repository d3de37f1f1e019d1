"""What a weak observer makes out in one view: each `Thing`, from pixels, categories and depth, and how they touch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int, Int64, UInt8

from pipeline.models.messages import ImagePart
from pipeline.models.symbolic.components import JUMP_M, JUMP_PER_M, Parts, find_parts
from pipeline.models.symbolic.knowledge import DOORS, LIGHTS, OPENING, STRUCTURE
from pipeline.models.symbolic.lexicon import canonical
from pipeline.models.symbolic.merge import merge_parts
from pipeline.models.symbolic.shapes import free_edges, hollow
from pipeline.models.symbolic.thing import Thing
from pipeline.models.symbolic.view import View
from pipeline.scene.color_names import COLOR_NAMES

PATCH_SHARE = 1 / 24**2
"""Share of the image in one patch of a vision transformer at 336 px (14 px patches): the unit of what it can see."""
PART_SHARE = 0.1 * PATCH_SHARE
"""Smaller patches are speckle: they are part of nothing."""
SEEN_SHARE = 0.5 * PATCH_SHARE
"""A thing with less area than this (67 pixels of 320 x 240) is not recognised."""
CLEAR_SHARE = 2.0 * PATCH_SHARE
"""A thing with less area than this (267 pixels of 320 x 240) is recognised but not with certainty."""
CUT_FACTOR = 2.0
"""A thing that the image border cuts must show this much more to be recognised: its outline says less."""
TRIM = 0.04
"""Share of samples dropped at each end of an extent: blended edge pixels lie between two surfaces."""
POINTS = 64
"""Points kept of a thing, about: a table of a square metre is then covered every 12 cm."""
GLARE = 0.96
"""Brightness from which on a light shines rather than being lit."""
MATTE_SHARE = 0.1
"""Share of a light that must not shine for its colour to be read there."""
MAX_PIXELS = 320 * 240
"""Larger views are read at a whole-number stride: the patches above do not need more."""
LEVEL_VIEW = 0.1
"""Sine of the angle between view and vertical below which "forward" is read off the image's up direction."""


def perceive(image: ImagePart) -> View:
    """Return what can be made out in an image; nothing where it has no observation."""
    from pipeline.models.symbolic.outline_kernels import outlines
    from pipeline.models.symbolic.things_kernels import describe, name_samples, part_boxes

    seen = image.observation
    if seen is None:
        return View(())
    height, width = seen.category.shape
    stride = max(1, math.ceil(math.sqrt(height * width / MAX_PIXELS)))
    depth = np.ascontiguousarray(seen.depth[::stride, ::stride], np.float32)
    least = max(4, int(PART_SHARE * depth.size))
    parts = find_parts(seen.category[::stride, ::stride], depth, least, len(seen.vocabulary))
    if not len(parts.category):
        return View(())
    points = _points(parts, depth, np.asarray(seen.K, np.float64), np.asarray(seen.up, np.float64), stride)
    low, high = part_boxes(points, parts.sample_begin, TRIM)
    kinds = _kinds(seen.vocabulary)
    building = kinds.structure[parts.category]
    owner = merge_parts(parts, depth, low, high, ~building)
    columns = depth.shape[1]
    names, brightest = name_samples(parts.sample_pixel, columns, stride, np.ascontiguousarray(image.color))
    found = Described(
        *describe(
            *(owner, parts.pixels, parts.bounds, low, high, parts.sample_begin, points, names, brightest),
            *(building, kinds.light[parts.category], (*depth.shape, len(COLOR_NAMES))),
            (SEEN_SHARE, CUT_FACTOR, GLARE, MATTE_SHARE, POINTS),
        )
    )
    things = _things(found, seen.vocabulary, kinds.canonical, parts, depth)
    touching, feet, covering, outline = outlines(
        *(parts.run_begin, parts.row_begin, parts.run_part, found.rank, depth, len(things)),
        *(np.float32(JUMP_M), np.float32(JUMP_PER_M)),
    )
    (upper, lower), (front, back) = touching.nonzero(), covering.nonzero()
    return View(
        things,
        _by_pair(upper, lower, touching[upper, lower] / feet[upper]),
        _by_pair(front, back, covering[front, back] / outline[back]),
    )


@dataclass(frozen=True, slots=True)
class _Kinds:
    """What is known of the names of a vocabulary."""

    canonical: tuple[str, ...]
    structure: Bool[np.ndarray, "C"]
    light: Bool[np.ndarray, "C"]


@lru_cache(maxsize=16)
def _kinds(vocabulary: tuple[str, ...]) -> _Kinds:
    names = tuple(canonical(name) for name in vocabulary)
    return _Kinds(names, np.array([name in STRUCTURE for name in names]), np.array([name in LIGHTS for name in names]))


@dataclass(frozen=True, slots=True)
class Described:
    """What `things_kernels.describe` returns of T things: see there."""

    first: Int64[np.ndarray, "T"]
    pixels: Int64[np.ndarray, "T"]
    bounds: Int64[np.ndarray, "T 4"]
    box: tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 3"]]
    best: Int64[np.ndarray, "T 2"]
    tallies: Int64[np.ndarray, "T C"]
    peak: UInt8[np.ndarray, "T"]
    squared_distance: Float[np.ndarray, "T"]
    points: Float[np.ndarray, "K 3"]
    point_begin: Int64[np.ndarray, "T1"]
    bright: Float[np.ndarray, "S"]
    bright_begin: Int64[np.ndarray, "T1"]
    rank: Int[np.ndarray, "P1"]


def _points(
    parts: Parts, depth: Float[np.ndarray, "H W"], K: Float[np.ndarray, "3 3"], up: Float[np.ndarray, "3"], stride: int
) -> Float[np.ndarray, "S 3"]:
    """Unproject the samples into right, up, forward."""
    from pipeline.models.symbolic.things_kernels import unproject

    up = up / _length(up)
    forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
    if _length(forward) < LEVEL_VIEW:
        top = np.array([0.0, np.sign(up[2]) or 1.0, 0.0])
        forward = top - (top @ up) * up
    forward /= _length(forward)
    (f_0, f_1, f_2), (u_0, u_1, u_2) = forward.tolist(), up.tolist()
    axes = np.array([[f_1 * u_2 - f_2 * u_1, f_2 * u_0 - f_0 * u_2, f_0 * u_1 - f_1 * u_0], up, forward])
    points: Float[np.ndarray, "S 3"] = unproject(parts.sample_pixel, depth, K, stride) @ axes.T
    return points


def _length(vector: Float[np.ndarray, "3"]) -> float:
    return math.sqrt(vector.dot(vector))


def _things(
    found: Described, names: Sequence[str], kinds: Sequence[str], parts: Parts, depth: Float[np.ndarray, "H W"]
) -> tuple[Thing, ...]:
    height, width = depth.shape
    columns = (
        *(parts.category[found.first], found.pixels, found.bounds, found.best, found.tallies, found.peak),
        *(found.squared_distance, found.point_begin[:-1], found.point_begin[1:]),
        *(found.bright_begin[:-1], found.bright_begin[1:]),
    )
    points = found.points[: found.point_begin.item(-1)].copy()  # the rest of the buffer is not kept with the view
    things = []
    for index, row in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
        name, pixels, (left, top, right, bottom), (most, next_most), counts, peak, squared, *begins = row
        kind, share = kinds[name], pixels / depth.size
        cut = left == 0 or top == 0 or right == width - 1 or bottom == height - 1
        edges, inner = _opening(found, index, kind, parts, depth) if kind in OPENING else ((), 0.0)
        thing = Thing(
            names[name],
            kind,
            share,
            (0.5 * (left + right + 1) / width, 0.5 * (top + bottom + 1) / height),
            cut,
            share >= CLEAR_SHARE * (CUT_FACTOR if cut and kind not in STRUCTURE else 1.0),
            COLOR_NAMES[most],
            COLOR_NAMES[next_most] if counts[next_most] >= 0.3 * sum(counts) else "",
            bright=float(np.add.reduce(found.bright[begins[2] : begins[3]]) / (begins[3] - begins[2])),
            peak=peak / 255.0,
            low=found.box[0][index],
            high=found.box[1][index],
            points=points[begins[0] : begins[1]],
            distance=math.sqrt(squared),
            free_edges=edges,
            hollow=inner,
        )
        things.append(thing)
    return tuple(things)


def _opening(
    found: Described, index: int, kind: str, parts: Parts, depth: Float[np.ndarray, "H W"]
) -> tuple[tuple[float, ...], float]:
    """Return what outline and depth tell of a thing that can stand open: free edges and hollow, see `shapes`."""
    from pipeline.models.symbolic.outline_kernels import cut_out

    mask, near = cut_out(parts.labels, found.rank, index, depth, found.bounds[index])
    return (free_edges(mask, near), 0.0) if kind in DOORS else ((), hollow(mask, near))


def _by_pair(
    first: Int[np.ndarray, "N"], second: Int[np.ndarray, "N"], shares: Float[np.ndarray, "N"]
) -> dict[tuple[int, int], float]:
    return dict(zip(zip(first.tolist(), second.tolist(), strict=True), shares.tolist(), strict=True))
