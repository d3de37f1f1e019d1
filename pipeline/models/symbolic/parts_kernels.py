# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops of `components`: one pass cuts rows into runs, a second joins runs of neighbouring rows, a third numbers them.

Runs of two rows are walked side by side, so that most pixels are looked at once; whether a pixel and the one below it
lie on one surface is asked only until two runs are found to touch. Single precision as in the arrays, and no
contraction of products and sums: the bits are those of the NumPy reference in the tests.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel

# Bytes that are compared with zero at once.
WORD = 8


@njit
def _on_one_surface(depth, row, column, down, across, jump_m, jump_per_m, bend):
    """Whether a pixel and the next one down or across lie on one surface, see `components.find_parts`."""
    here, there = depth[row, column], depth[row + down, column + across]
    if abs(there - here) <= jump_m + jump_per_m * there:
        return True
    at, count = (row, depth.shape[0]) if down else (column, depth.shape[1])
    first, stop = max(0, at - 2), min(at + 2, count - 2)
    if stop - first < 2:
        return False
    # Two straight triples in a row, of those that hold both pixels or reach to one beside them.
    row, column = row - (at - first) * down, column - (at - first) * across
    one, two = _inverse(depth[row, column]), _inverse(depth[row + down, column + across])
    straight = False
    for _ in range(first, stop):
        three = _inverse(depth[row + 2 * down, column + 2 * across])
        before, straight = straight, abs(one - np.float32(2.0) * two + three) <= bend * two
        if before and straight:
            return True
        one, two, row, column = two, three, row + down, column + across
    return False


@njit
def _breaks(own, before, z, z_before, jump_m, jump_per_m, ends):
    """Mark where neighbours differ or are not close in depth; no branches, so that many are done at a time."""
    for column in range(len(own)):
        ends[column] = np.uint8(
            (own[column] != before[column]) | (not abs(z[column] - z_before[column]) <= jump_m + jump_per_m * z[column])
        )


@njit
def _inverse(depth_m):
    return np.float32(1.0) / depth_m if depth_m > 0 else np.float32(0.0)


@njit
def _root(parent, run):
    while parent[run] != run:
        parent[run] = parent[parent[run]]
        run = parent[run]
    return run


@kernel
def find_runs(category, depth, names, jump_m, jump_per_m, bend):
    """Return runs in reading order: start and root (R,) int32 and row begins (H + 1,) int32; roots are first runs.

    Takes category (H, W) int32, depth (H, W) float32 and three float32. What has no depth, no category or one of
    `names` and more starts runs with root -1, which may join what does not belong together.
    """
    height, width = category.shape
    start = np.empty(height * width + 1, np.int32)
    parent = np.empty(height * width + 1, np.int32)
    kind = np.empty(height * width + 1, np.int32)
    begins = np.empty(height + 1, np.int32)
    own = np.empty(width, np.int32)
    ends = np.zeros((width + WORD - 1) // WORD * WORD, np.uint8)
    words = ends.view(np.uint64)
    runs = 0
    for row in range(height):
        begins[row] = runs
        line, z = category[row], depth[row]
        for column in range(width):
            own[column] = line[column] if (line[column] < names) & (line[column] >= 0) & (z[column] > 0) else -1
        ends[0] = 1
        _breaks(own[1:], own[:-1], z[1:], z[:-1], jump_m, jump_per_m, ends[1:])
        for word in range(len(words)):
            if words[word] == 0:  # most neighbours lie on one surface
                continue
            for column in range(WORD * word, min(WORD * word + WORD, width)):
                if not ends[column]:
                    continue
                if (
                    column > 0
                    and own[column] == own[column - 1]
                    and (own[column] < 0 or _on_one_surface(depth, row, column - 1, 0, 1, jump_m, jump_per_m, bend))
                ):
                    continue
                start[runs], parent[runs], kind[runs] = row * width + column, runs, own[column]
                runs += 1
    begins[height] = runs
    start[runs] = height * width
    for row in range(height - 1):
        upper, lower = begins[row], begins[row + 1]
        while upper < begins[row + 1] and lower < begins[row + 2]:
            upper_end, lower_end = start[upper + 1], start[lower + 1] - width
            if kind[upper] >= 0 and kind[upper] == kind[lower]:
                one, two = _root(parent, upper), _root(parent, lower)
                if one != two:
                    for pixel in range(max(start[upper], start[lower] - width), min(upper_end, lower_end)):
                        if _on_one_surface(depth, row, pixel - row * width, 1, 0, jump_m, jump_per_m, bend):
                            parent[max(one, two)] = min(one, two)
                            break
            if upper_end <= lower_end:
                upper += 1
            if lower_end <= upper_end:
                lower += 1
    for run in range(runs):
        parent[run] = _root(parent, run) if kind[run] >= 0 else -1
    return start[: runs + 1], parent[:runs], begins


@kernel
def number_parts(start, root, category, least, samples):
    """Return part of each run (R,) int32, and labels, category, pixels, bounds and samples as in `Parts`.

    Takes what `find_runs` returned, category (H, W) int32, the fewest pixels of a part and the most samples of one.
    """
    height, width = category.shape
    runs = len(root)
    area = np.zeros(runs, np.int64)
    for run in range(runs):
        if root[run] >= 0:
            area[root[run]] += start[run + 1] - start[run]
    first = np.empty(runs, np.int64)
    count = 0
    for run in range(runs):
        if area[run] >= least and area[run] > 0:  # kept in order: larger parts first, then those met first
            place = count
            while place > 0 and area[first[place - 1]] < area[run]:
                first[place] = first[place - 1]
                place -= 1
            first[place] = run
            count += 1
    number = np.full(runs, -1, np.int32)
    kinds, pixels = np.empty(count, np.int64), np.empty(count, np.int64)
    bounds = np.empty((count, 4), np.int64)
    begins = np.zeros(count + 1, np.int64)
    for part in range(count):
        run = first[part]
        number[run] = part
        kinds[part] = category[start[run] // width, start[run] % width]
        pixels[part] = area[run]
        bounds[part] = (width, height, -1, -1)
        begins[part + 1] = begins[part] + min(area[run], samples)
    sample = np.empty(begins[count], np.int64)
    seen, taken = np.zeros(count, np.int64), np.zeros(count, np.int64)
    labels = np.empty(height * width, np.int32)
    for run in range(runs):
        begin, end = start[run], start[run + 1]
        part = number[root[run]] if root[run] >= 0 else -1
        number[run] = part  # roots come first, so none that is still looked up changes
        labels[begin:end] = part
        if part < 0:
            continue
        row, left = begin // width, begin % width
        bounds[part, 0] = min(bounds[part, 0], left)
        bounds[part, 1] = min(bounds[part, 1], row)
        bounds[part, 2] = max(bounds[part, 2], left + end - begin - 1)
        bounds[part, 3] = row
        wanted = begins[part + 1] - begins[part]
        while taken[part] < wanted:
            position = np.int64((taken[part] + 0.5) * pixels[part] / wanted)
            if position >= seen[part] + end - begin:
                break
            sample[begins[part] + taken[part]] = begin + position - seen[part]
            taken[part] += 1
        seen[part] += end - begin
    return number, labels.reshape(height, width), kinds, pixels, bounds, sample, begins
