"""The symbolic observer in plain NumPy: slow, obvious, and bit for bit what `perceive` returns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int64

from pipeline.models.messages import ImagePart
from pipeline.models.symbolic.components import jump_limit
from pipeline.models.symbolic.knowledge import DOORS, LIGHTS, OPENING, STRUCTURE
from pipeline.models.symbolic.lexicon import canonical
from pipeline.models.symbolic.perceive import (
    CLEAR_SHARE,
    CUT_FACTOR,
    GLARE,
    LEVEL_VIEW,
    MATTE_SHARE,
    MAX_PIXELS,
    PART_SHARE,
    POINTS,
    SEEN_SHARE,
    TRIM,
)
from pipeline.models.symbolic.thing import Thing
from pipeline.models.symbolic.view import View
from pipeline.scene.color_names import COLOR_NAMES, name_colors
from tests.models.symbolic_reference_parts import Parts, find_parts, free_edges, hollow, merge_parts


def perceive(image: ImagePart) -> View:
    """Return what can be made out in an image; nothing where it has no observation."""
    seen = image.observation
    if seen is None:
        return View(())
    height, width = seen.category.shape
    stride = max(1, int(np.ceil(np.sqrt(height * width / MAX_PIXELS))))
    category, depth = seen.category[::stride, ::stride], np.asarray(seen.depth[::stride, ::stride], np.float32)
    color = np.ascontiguousarray(image.color[::stride, ::stride])
    category = np.where(category < len(seen.vocabulary), category, -1)
    pixels = category.size
    parts = find_parts(category, depth, max(4, int(PART_SHARE * pixels)))
    if not len(parts.category):
        return View(())
    points = _points(parts, depth, np.asarray(seen.K, np.float64), np.asarray(seen.up, np.float64), stride)
    low, high = _boxes(parts, points)
    building = np.array([canonical(seen.vocabulary[name]) in STRUCTURE for name in parts.category])
    owner = merge_parts(parts, depth, low, high, ~building)
    rgb = color.reshape(-1, 3)[parts.sample_pixel] / 255.0
    names, bright = name_colors(rgb), rgb.max(axis=1)
    begins = np.searchsorted(parts.sample_part, np.arange(len(owner) + 1))
    things: list[tuple[Thing, int]] = []
    for first in np.unique(owner):
        members = np.flatnonzero(owner == first)
        samples = np.concatenate([np.arange(begins[m], begins[m + 1]) for m in members])
        thing = _thing(
            seen.vocabulary[parts.category[first]],
            int(parts.pixels[members].sum()) / pixels,
            parts.bounds[members],
            (low[members].min(axis=0), high[members].max(axis=0)),
            points[samples],
            _matte(canonical(seen.vocabulary[parts.category[first]]), names[samples], bright[samples]),
            bright[samples],
            depth.shape,
        )
        if thing is not None:
            if thing.kind in OPENING:
                thing = _shaped(thing, np.isin(parts.labels, members), depth, parts.bounds[members])
            things.append((thing, int(first)))
    things.sort(key=lambda pair: (-pair[0].share, pair[1]))
    index_of_part = np.full(len(owner) + 1, -1)
    rank = {first: index for index, (_, first) in enumerate(things)}
    index_of_part[:-1] = [rank.get(int(first), -1) for first in owner]
    image_of_things = index_of_part[parts.labels]
    return View(
        tuple(thing for thing, _ in things),
        _contacts(image_of_things, depth, len(things)),
        _covers(image_of_things, depth, len(things)),
    )


def _points(
    parts: Parts, depth: Float[np.ndarray, "H W"], K: Float[np.ndarray, "3 3"], up: Float[np.ndarray, "3"], stride: int
) -> Float[np.ndarray, "S 3"]:
    """Unproject the samples into right, up, forward."""
    row, column = np.divmod(parts.sample_pixel, depth.shape[1])
    z = depth.ravel()[parts.sample_pixel].astype(np.float64)
    x = (column * stride + 0.5 - K[0, 2]) / K[0, 0] * z
    y = (row * stride + 0.5 - K[1, 2]) / K[1, 1] * z
    up = up / np.linalg.norm(up)
    forward = np.array([0.0, 0.0, 1.0]) - up[2] * up
    if np.linalg.norm(forward) < LEVEL_VIEW:
        top = np.array([0.0, np.sign(up[2]) or 1.0, 0.0])
        forward = top - (top @ up) * up
    forward /= np.linalg.norm(forward)
    axes = np.stack([np.cross(forward, up), up, forward])
    return np.stack([x, y, z], axis=1) @ axes.T


def _boxes(parts: Parts, points: Float[np.ndarray, "S 3"]) -> tuple[Float[np.ndarray, "P 3"], Float[np.ndarray, "P 3"]]:
    count = len(parts.category)
    begins = np.searchsorted(parts.sample_part, np.arange(count + 1))
    low, high = np.empty((count, 3)), np.empty((count, 3))
    for part in range(count):
        ordered = np.sort(points[begins[part] : begins[part + 1]], axis=0)
        trim = int(TRIM * len(ordered))
        low[part], high[part] = ordered[trim], ordered[len(ordered) - 1 - trim]
    return low, high


def _thing(
    name: str,
    share: float,
    bounds: Int64[np.ndarray, "G 4"],
    box: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    points: Float[np.ndarray, "S 3"],
    colors: Int64[np.ndarray, "C"],
    bright: Float[np.ndarray, "S"],
    shape: tuple[int, ...],
) -> Thing | None:
    height, width = shape
    left, top = bounds[:, 0].min(), bounds[:, 1].min()
    right, bottom = bounds[:, 2].max(), bounds[:, 3].max()
    cut = bool(left == 0 or top == 0 or right == width - 1 or bottom == height - 1)
    kind = canonical(name)
    needed = CUT_FACTOR if cut and kind not in STRUCTURE else 1.0
    if share < SEEN_SHARE * needed:
        return None
    counts = np.bincount(colors, minlength=len(COLOR_NAMES))
    order = np.argsort(-counts, kind="stable")
    second = COLOR_NAMES[int(order[1])] if counts[order[1]] >= 0.3 * len(colors) else ""
    return Thing(
        name=name,
        kind=kind,
        share=share,
        center=(float(0.5 * (left + right + 1) / width), float(0.5 * (top + bottom + 1) / height)),
        cut=cut,
        clear=share >= CLEAR_SHARE * needed,
        color=COLOR_NAMES[int(order[0])],
        second_color=second,
        bright=float(bright.mean()),
        peak=float(np.partition(bright, at := int(0.98 * (len(bright) - 1)))[at]),
        low=box[0],
        high=box[1],
        points=_kept_points(points, *box),
        distance=float(np.sqrt(np.partition((points**2).sum(axis=1), len(points) // 2)[len(points) // 2])),
    )


def _matte(kind: str, colors: Int64[np.ndarray, "S"], bright: Float[np.ndarray, "S"]) -> Int64[np.ndarray, "C"]:
    """Leave out what shines of a light: glare has no colour of its own, the rest of the light does."""
    dim = bright < GLARE
    return colors[dim] if kind in LIGHTS and dim.mean() >= MATTE_SHARE else colors


def _kept_points(
    points: Float[np.ndarray, "S 3"], low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "K 3"]:
    """Return some of the points in the box; those outside it are blended edges."""
    inside = points[((points >= low) & (points <= high)).all(axis=1)]
    return inside[:: max(1, len(inside) // POINTS)].astype(np.float32)


def _shaped(
    thing: Thing, mask: Bool[np.ndarray, "H W"], depth: Float[np.ndarray, "H W"], bounds: Int64[np.ndarray, "G 4"]
) -> Thing:
    """Add what outline and depth tell of a thing that can stand open."""
    left, top = np.maximum(0, bounds[:, :2].min(axis=0) - 1)
    right, bottom = bounds[:, 2:].max(axis=0) + 2
    mask, depth = mask[top:bottom, left:right], depth[top:bottom, left:right]
    if thing.kind in DOORS:
        return replace(thing, free_edges=free_edges(mask, depth))
    return replace(thing, hollow=hollow(mask, depth))


def _contacts(
    thing: Int64[np.ndarray, "H W"], depth: Float[np.ndarray, "H W"], count: int
) -> dict[tuple[int, int], float]:
    """Count, per pair of things, the columns where one ends right above the other at the same depth."""
    upper, lower = thing[:-1], thing[1:]
    where = np.flatnonzero((upper != lower) & (upper >= 0))
    above, below = upper.ravel()[where], lower.ravel()[where]
    near, far = depth[1:].ravel()[where], depth[:-1].ravel()[where]
    outline = np.bincount(above, minlength=count)
    touching = (below >= 0) & (np.abs(near - far) <= jump_limit(far))
    pairs, found = np.unique(above[touching] * count + below[touching], return_counts=True)
    return {
        (int(pair // count), int(pair % count)): float(n / outline[pair // count])
        for pair, n in zip(pairs, found, strict=True)
    }


def _covers(
    thing: Int64[np.ndarray, "H W"], depth: Float[np.ndarray, "H W"], count: int
) -> dict[tuple[int, int], float]:
    """Count, per pair of things, the outline pixels of one beyond which the other lies nearer."""
    pairs, outline = [], np.zeros(count, np.int64)
    for image, z in ((thing, depth), (thing.T, depth.T)):
        where = np.flatnonzero(image[:-1] != image[1:])
        first, second = image[:-1].ravel()[where], image[1:].ravel()[where]
        step = z[1:].ravel()[where] - z[:-1].ravel()[where]
        limit = jump_limit(z[:-1].ravel()[where])
        for back, front, nearer in ((first, second, -step), (second, first, step)):
            outline += np.bincount(back[back >= 0], minlength=count)
            hidden = (back >= 0) & (front >= 0) & (nearer > limit)
            pairs.append(front[hidden] * count + back[hidden])
    found, counts = np.unique(np.concatenate(pairs), return_counts=True)
    return {
        (int(pair // count), int(pair % count)): float(n / outline[pair % count])
        for pair, n in zip(found, counts, strict=True)
    }
