# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Culling of whole blocks of Gaussians against the sides of the view. Serial: thousands of blocks take microseconds."""

from __future__ import annotations

from pipeline.cached_kernels import kernel


@kernel
def cull(centers, halves, reach, sides, kept):
    """Write the blocks that touch the inside of every side to `kept` (int32), ascending; return how many.

    A side is (normal (3), offset, reach factor) in float64: a block is inside when the largest value of
    normal . x + offset over its box, plus factor times its largest deviation, is not negative.
    """
    count = 0
    for block in range(len(centers)):
        inside = True
        for side in range(len(sides)):
            value = sides[side, 3] + sides[side, 4] * reach[block]
            size = abs(sides[side, 3])
            for axis in range(3):
                term = sides[side, axis] * centers[block, axis]
                value += term + abs(sides[side, axis]) * halves[block, axis]
                size += abs(term)
            # A relative hair keeps blocks that rounding would put just outside.
            inside = inside and value >= -1e-12 * size
        if inside:
            kept[count] = block
            count += 1
    return count
