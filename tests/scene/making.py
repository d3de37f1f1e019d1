"""Small scenes and PLY files for tests."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import Camera, look_at
from pipeline.scene import Gaussians, Scene, Semantics, View


def random_gaussians(count: int = 40, degree: int = 3, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)
    quats = rng.normal(size=(count, 4))
    return Gaussians(
        rng.normal(size=(count, 3)).astype(np.float32),
        (quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        rng.uniform(-6, -1, (count, 3)).astype(np.float32),
        rng.uniform(-4, 4, count).astype(np.float32),
        rng.uniform(-0.9, 0.9, (count, (degree + 1) ** 2, 3)).astype(np.float32),
    )


def camera(eye: tuple[float, float, float] = (3.0, 0.0, 1.0), width: int = 32, height: int = 24) -> Camera:
    K = np.array([[30.0, 0, width / 2], [0, 30.0, height / 2], [0, 0, 1]])
    return Camera(K, look_at(np.array(eye), np.zeros(3), np.array([0.0, 0, 1])), width, height)


def small_scene(name: str = "flat", count: int = 40) -> Scene:
    rng = np.random.default_rng(1)
    embedding = rng.normal(size=(count, 8))
    return Scene(
        name=name,
        gaussians=random_gaussians(count, degree=1),
        views=tuple(View(f"v{i}", camera((3.0, float(i), 1.0))) for i in range(3)),
        semantics=Semantics(
            ("chair", "table"),
            category=rng.integers(-1, 2, count).astype(np.int32),
            embedding=(embedding / np.linalg.norm(embedding, axis=1, keepdims=True)).astype(np.float16),
            instance=rng.integers(-1, 4, count).astype(np.int32),
        ),
    )


def ply(
    columns: dict[str, np.ndarray],
    *,
    form: str = "binary_little_endian",
    newline: str = "\n",
    kinds: dict[str, str] | None = None,
    before: str = "",
) -> bytes:
    """A PLY of named columns, in the order given; `kinds` overrides "float" by name."""
    names = {"float": "f4", "double": "f8", "uchar": "u1", "float32": "f4", "int": "i4"}
    kinds = kinds or {}
    count = len(next(iter(columns.values())))
    lines = ["ply", f"format {form} 1.0", "comment made for a test", *before.splitlines(), f"element vertex {count}"]
    lines += [f"property {kinds.get(name, 'float')} {name}" for name in columns]
    header = newline.join([*lines, "end_header", ""]).encode()
    if form == "ascii":
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        return header + newline.join(" ".join(repr(value) for value in row) for row in rows).encode()
    order = ">" if "big" in form else "<"
    table = np.zeros(count, [(name, order + names[kinds.get(name, "float")]) for name in columns])
    for name, column in columns.items():
        table[name] = column
    return header + table.tobytes()


def inria_columns(gaussians: Gaussians) -> dict[str, np.ndarray]:
    columns = {name: gaussians.means[:, i] for i, name in enumerate("xyz")}
    columns |= {f"f_dc_{i}": gaussians.sh[:, 0, i] for i in range(3)}
    per_channel = gaussians.sh.shape[1] - 1
    for channel in range(3):
        for k in range(per_channel):
            columns[f"f_rest_{channel * per_channel + k}"] = gaussians.sh[:, 1 + k, channel]
    columns["opacity"] = gaussians.opacity_logits
    columns |= {f"scale_{i}": gaussians.log_scales[:, i] for i in range(3)}
    return columns | {f"rot_{i}": gaussians.quats[:, i] for i in range(4)}
