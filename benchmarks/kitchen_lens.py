"""Fits the lens and place of the 7-Scenes photographs: edges of depth should fall on edges of the picture.

Run: python -m benchmarks.kitchen_lens SEQUENCE [--offset 0]. Every fifth frame from the offset is used, so two offsets
give two fits that share no frame. Printed: focal length, principal point (pixels), shift (metres), edge contrast.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, minimum_filter
from scipy.optimize import minimize

from pipeline.scene.captures import Frame, read_seven_scenes

EDGE_M = 0.08
"""A step in depth this large is an edge."""
FAR_M = 3.5
"""Depth beyond is too coarse."""
Edges = tuple[np.ndarray, np.ndarray]


def edges(frame: Frame) -> Edges:
    """Return the near side of depth edges, in the depth camera's axes, and the picture's gradient over its mean."""
    depth = frame.read_depth()
    grey = gaussian_filter(frame.read_image().astype(float).mean(axis=2), 1.0)
    gradient = np.hypot(*np.gradient(grey))
    near = (depth > 0) & (depth < FAR_M) & (-minimum_filter(-depth, 3) - depth > EDGE_M)
    return frame.depth_lens.unproject(depth)[near], np.minimum(gradient / gradient.mean(), 5.0)


def contrast(lens: np.ndarray, found: list[Edges]) -> float:
    """Return the mean gradient at depth edges: 1 is what chance gives."""
    f, cx, cy, shift_x, shift_y = lens
    scores = []
    for points, gradient in found:
        x = f * (points[:, 0] + shift_x) / points[:, 2] + cx - 0.5
        y = f * (points[:, 1] + shift_y) / points[:, 2] + cy - 0.5
        scores.append(map_coordinates(gradient, [y, x], order=1, mode="constant", cval=1.0).mean())
    return float(np.mean(scores))


def main() -> None:
    """Fit from three starts and print the fits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sequence")
    parser.add_argument("--offset", type=int, default=0)
    arguments = parser.parse_args()
    capture = read_seven_scenes(arguments.sequence, register=False)
    found = [edges(frame) for frame in capture.frames[arguments.offset :: 5]]
    print(f"as the data set has it: contrast {contrast(np.array([585, 320, 240, 0, 0]), found):.3f}")
    steps = np.diag([6, 5, 5, 0.008, 0.006])
    for focal in (515.0, 535.0, 585.0):
        start = np.array([focal, 320, 240, 0, 0])
        options = {"initial_simplex": np.vstack([start, start + steps]), "xatol": 0.05, "fatol": 1e-4, "maxfev": 400}
        fit = minimize(lambda lens: -contrast(lens, found), start, method="Nelder-Mead", options=options)
        values = ", ".join(f"{value:.4g}" for value in fit.x)
        print(f"from f {focal:.0f}: f, cx, cy, x, y = {values}; contrast {-fit.fun:.3f}")


if __name__ == "__main__":
    main()
