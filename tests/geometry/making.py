"""Random rotations, poses and cameras for tests of laws."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from pipeline.geometry import Camera

seeds = st.integers(0, 2**32 - 1)


def rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation, uniform over all: Gram-Schmidt of Gaussian columns, the last by the right-hand rule."""
    a, b = rng.normal(size=(2, 3))
    x = a / np.linalg.norm(a)
    y = b - x * (x @ b)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def pose(rng: np.random.Generator, reach: float = 10.0) -> np.ndarray:
    return np.concatenate([rotation(rng), rng.uniform(-reach, reach, (3, 1))], axis=1)


def camera(rng: np.random.Generator) -> Camera:
    width, height = (int(v) for v in rng.integers(8, 200, 2))
    K = np.array(
        [
            [rng.uniform(10, 300), 0, rng.uniform(0, width)],
            [0, rng.uniform(10, 300), rng.uniform(0, height)],
            [0, 0, 1],
        ]
    )
    return Camera(K, pose(rng), width, height)
