# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Bilinear enlargement of an image, row by row: two source rows are mixed, then spread over the columns. Serial."""

from __future__ import annotations

import numpy as np

from pipeline.cached_kernels import kernel


@kernel
def mix(image, low_rows, row_shares, low_columns, column_shares, enlarged):
    """Write the pixels of `enlarged` (H, W, c) from `image` (h, w, c), both float32.

    low_rows (H,) and low_columns (W,) int64 name the first of the two source rows and columns a pixel lies between (the
    last one stands for its own neighbour); row_shares and column_shares, float32, are the share of the second.
    """
    height, width, channels = image.shape
    flat = image.reshape(height, width * channels)
    row = np.empty(width * channels, np.float32)
    for y in range(len(low_rows)):
        upper, lower = flat[low_rows[y]], flat[min(low_rows[y] + 1, height - 1)]
        share = row_shares[y]
        for k in range(width * channels):
            row[k] = upper[k] + (lower[k] - upper[k]) * share
        for x in range(len(low_columns)):
            left = low_columns[x] * channels
            right = min(low_columns[x] + 1, width - 1) * channels
            share = column_shares[x]
            for channel in range(channels):
                here = row[left + channel]
                enlarged[y, x, channel] = here + (row[right + channel] - here) * share
