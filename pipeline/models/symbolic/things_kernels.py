# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops over the samples of a view's parts: where they lie, their boxes, and what the things they make up look like.

Everything is chosen, counted or compared; sums that depend on their order are left to NumPy, so that the result has
the bits of the NumPy reference in the tests.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel
from pipeline.models.symbolic.color_kernels import name_color

# Distinct levels of an 8-bit colour channel.
LEVELS = 256


@kernel
def unproject(sample_pixel, depth, K, stride):
    """Return the samples' positions in camera axes, (S, 3) float64; takes depth (H, W) float32 and K (3, 3) float64."""
    width = depth.shape[1]
    points = np.empty((len(sample_pixel), 3))
    for sample in range(len(sample_pixel)):
        row, column = sample_pixel[sample] // width, sample_pixel[sample] % width
        z = np.float64(depth[row, column])
        points[sample, 0] = (column * stride + 0.5 - K[0, 2]) / K[0, 0] * z
        points[sample, 1] = (row * stride + 0.5 - K[1, 2]) / K[1, 1] * z
        points[sample, 2] = z
    return points


@kernel
def name_samples(sample_pixel, width, stride, color):
    """Return name and brightest channel (S,) uint8 of the samples; takes color (H, W, 3) uint8, read at a stride."""
    names, brightest = np.empty(len(sample_pixel), np.uint8), np.empty(len(sample_pixel), np.uint8)
    for sample in range(len(sample_pixel)):
        row, column = sample_pixel[sample] // width * stride, sample_pixel[sample] % width * stride
        red, green, blue = color[row, column, 0], color[row, column, 1], color[row, column, 2]
        brightest[sample] = max(red, green, blue)
        names[sample] = name_color(red, green, blue)
    return names, brightest


@kernel
def part_boxes(points, begins, trim_share):
    """Return lower and upper corners (P, 3) of each part's points (S, 3) without `trim_share` at either end."""
    count = len(begins) - 1
    low, high = np.empty((count, 3)), np.empty((count, 3))
    for part in range(count):
        size = begins[part + 1] - begins[part]
        kept = np.int64(trim_share * size) + 1
        least = np.empty(kept)
        for axis in range(3):
            low[part, axis] = _nth_least(points[begins[part] : begins[part + 1], axis], 1.0, least)
            high[part, axis] = -_nth_least(points[begins[part] : begins[part + 1], axis], -1.0, least)
    return low, high


@njit
def _nth_least(values, sign, least):
    """Value of rank len(least) - 1 among sign * values; `least` holds the smallest so far, ascending."""
    kept = len(least)
    filled = 0
    for index in range(len(values)):
        value = sign * values[index]
        if filled == kept and value >= least[kept - 1]:
            continue
        place = min(filled, kept - 1)
        while place > 0 and least[place - 1] > value:
            least[place] = least[place - 1]
            place -= 1
        least[place] = value
        filled = min(filled + 1, kept)
    return least[kept - 1]


@kernel
def describe(owner, pixels, bounds, low, high, begins, points, colors, brightest, structure, light, shape, limits):
    """Return what is recognised, largest first, and all that is chosen or counted of its samples.

    Takes owner, pixels (P,) int64, bounds (P, 4) int64, low, high (P, 3) float64, begins (P + 1,) int64, points (S, 3)
    float64, colors, brightest (S,) uint8, structure and light (P,) bool, and shape (height, width, colour names).
    limits is (least share of the image, its factor for what is cut, level of glare, least matte share, points kept).
    Returns first part, pixels (T,) int64, bounds (T, 4) int64, low, high (T, 3) float64, most frequent colours (T, 2)
    and counts of all (T, C) int64, peak (T,) uint8, squared median distance (T,) float64, kept points (K, 3) float32
    and brightness (S,) float64 of its samples in order, each with begins (T + 1,) int64, and the rank of each part's
    thing (P + 1,) int32, -1 none.
    """
    height, width, names = shape
    seen_share, cut_factor, glare, matte_share, wanted = limits
    parts = len(owner)
    total, edges = np.zeros(parts, np.int64), np.empty((parts, 4), np.int64)
    lower, upper = low.copy(), high.copy()
    for part in range(parts):
        first = owner[part]
        total[first] += pixels[part]
        if part == first:
            edges[first] = bounds[part]
            continue
        edges[first, :2] = np.minimum(edges[first, :2], bounds[part, :2])
        edges[first, 2:] = np.maximum(edges[first, 2:], bounds[part, 2:])
        lower[first] = np.minimum(lower[first], low[part])
        upper[first] = np.maximum(upper[first], high[part])
    firsts = np.empty(parts, np.int64)
    count = 0
    for first in range(parts):
        if owner[first] != first:
            continue
        cut = edges[first, 0] == 0 or edges[first, 1] == 0
        cut = cut or edges[first, 2] == width - 1 or edges[first, 3] == height - 1
        needed = cut_factor if cut and not structure[first] else 1.0
        if total[first] / (height * width) < seen_share * needed:
            continue
        place = count
        while place > 0 and total[firsts[place - 1]] < total[first]:
            firsts[place] = firsts[place - 1]
            place -= 1
        firsts[place] = first
        count += 1
    firsts = firsts[:count].copy()
    rank = np.full(parts + 1, -1, np.int32)
    peaks, squares = np.empty(count, np.uint8), np.empty(count)
    tallies = np.zeros((count, names), np.int64)
    bright, bright_begins = np.empty(len(points), np.uint8), np.zeros(count + 1, np.int64)
    kept, kept_begins = np.empty((len(points), 3), np.float32), np.zeros(count + 1, np.int64)
    squared, inside = np.empty(len(points)), np.empty(len(points), np.int64)
    for thing in range(count):
        first = firsts[thing]
        low_x, low_y, low_z = lower[first, 0], lower[first, 1], lower[first, 2]
        high_x, high_y, high_z = upper[first, 0], upper[first, 1], upper[first, 2]
        size, within = 0, 0
        for part in range(first, parts):
            if owner[part] != first:
                continue
            rank[part] = thing
            for sample in range(begins[part], begins[part + 1]):
                bright[bright_begins[thing] + size] = brightest[sample]
                tallies[thing, colors[sample]] += 1
                x, y, z = points[sample, 0], points[sample, 1], points[sample, 2]
                squared[size] = x * x + y * y + z * z
                size += 1
                inside[within] = sample
                within += (x >= low_x) & (x <= high_x) & (y >= low_y) & (y <= high_y) & (z >= low_z) & (z <= high_z)
        bright_begins[thing + 1] = bright_begins[thing] + size
        peaks[thing] = _peak(bright[bright_begins[thing] : bright_begins[thing + 1]])
        squares[thing] = _nth(squared, size, size // 2)
        if light[first]:
            _leave_out_glare(tallies[thing], owner, first, begins, colors, brightest, size, glare, matte_share)
        at = kept_begins[thing]
        for place in range(0, within, max(1, within // wanted)):
            for axis in range(3):
                kept[at, axis] = points[inside[place], axis]
            at += 1
        kept_begins[thing + 1] = at
    best = np.empty((count, 2), np.int64)
    for thing in range(count):
        best[thing] = _most(tallies[thing])
    box, shine = (lower[firsts], upper[firsts]), bright / 255.0
    return (
        *(firsts, total[firsts], edges[firsts], box, best, tallies, peaks, squares),
        *(kept, kept_begins, shine, bright_begins, rank),
    )


@njit
def _peak(bright):
    """Level that only the brightest 2 % exceed."""
    histogram = np.zeros(LEVELS, np.int64)
    for level in bright:
        histogram[level] += 1
    left, peak = np.int64(0.98 * (len(bright) - 1)), 0
    while left >= histogram[peak]:
        left -= histogram[peak]
        peak += 1
    return peak


@njit
def _leave_out_glare(tally, owner, first, begins, colors, brightest, size, glare, matte_share):
    """Count only the colours that do not shine, where those are enough."""
    dim = np.zeros(len(tally), np.int64)
    for part in range(first, len(owner)):
        if owner[part] == first:
            for sample in range(begins[part], begins[part + 1]):
                dim[colors[sample]] += brightest[sample] / 255.0 < glare
    if dim.sum() / size >= matte_share:
        tally[:] = dim


@njit
def _most(tally):
    """The two most frequent colours, of equals the earlier."""
    first, second = 0, -1
    for color in range(1, len(tally)):
        if tally[color] > tally[first]:
            first, second = color, first
        elif second < 0 or tally[color] > tally[second]:
            second = color
    return first, second


@njit
def _nth(values, size, nth):
    """Value of rank `nth` among the first `size`, which are reordered (Hoare's selection)."""
    begin, end = 0, size - 1
    while begin < end:
        pivot = values[(begin + end) // 2]
        i, j = begin, end
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if nth <= j:
            end = j
        elif nth >= i:
            begin = i
        else:
            break
    return values[nth]
