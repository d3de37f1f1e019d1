"""Stress cases that must not reach the renderer: refused, dropped at load with a count, or warned of."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from pipeline.scene.captures.nerfstudio import read_nerfstudio
from pipeline.scene.formats.ply import ply_bytes
from pipeline.scene.formats.read import read_gaussians
from pipeline.scene.gaussians import Gaussians
from schemas.errors import InputError
from tests.render.scenes import gaussians, random_scene
from tests.render.stress_cases import Case, word_case

COUNT = 64


def refused(name: str, value: float) -> str:
    """The field an InputError names when `value` is put into an array of a scene; nothing if it passes."""
    scene = random_scene(0, 4)
    arrays = {key: np.array(getattr(scene, key)) for key in ("means", "quats", "log_scales", "opacity_logits", "sh")}
    arrays[name].reshape(4, -1)[1] = value
    try:
        Gaussians(**arrays)
    except InputError as error:
        return str(error.field)
    return "accepted"


def ply_with(**columns: float) -> bytes:
    """A PLY of ordinary Gaussians whose first ones hold what no Gaussian may: one property of one Gaussian each."""
    scene = random_scene(0, COUNT, sh_degree=0)
    data = ply_bytes(scene)
    head = data.index(b"end_header\n") + len(b"end_header\n")
    names = [line.split()[-1].decode() for line in data[:head].splitlines() if line.startswith(b"property")]
    table = np.frombuffer(data[head:], "<f4").reshape(COUNT, -1).copy()
    for row, (name, value) in enumerate(columns.items()):
        for column in [k for k, known in enumerate(names) if known.startswith(name)]:
            table[row, column] = value
    return data[:head] + table.tobytes()


def read(data: bytes):
    """What the reader makes of these bytes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gaussians.ply"
        path.write_bytes(data)
        return read_gaussians(str(path))


def dropped() -> str:
    """Count by reason of a file with one of every fault."""
    file = read(ply_with(x=np.nan, rot_=0.0, scale_1=np.inf, opacity=np.nan, f_dc_0=-np.inf))
    return f"{len(file.gaussians)} kept; " + ", ".join(
        f"{reason} {count}" for reason, count in sorted(file.dropped.items())
    )


def unactivated() -> str:
    """Whether a file that holds opacities instead of logits is warned of."""
    scene = gaussians(np.random.default_rng(0).uniform(-1, 1, (5000, 3)), opacity_logits=np.linspace(0, 1, 5000))
    return "warned" if any("opacit" in line for line in read(ply_bytes(scene)).warnings) else "silent"


def distorted() -> str:
    """What happens to a capture whose lens is distorted."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "transforms.json"
        frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
        lens = {"fl_x": 50.0, "fl_y": 50.0, "cx": 16, "cy": 12, "w": 32, "h": 24, "camera_model": "OPENCV"}
        path.write_text(json.dumps({**lens, "k1": 0.1, "frames": [frame]}))
        try:
            read_nerfstudio(str(path))
        except InputError:
            return "refused"
    return "accepted"


INPUT_CASES: tuple[Case, ...] = (
    word_case("quaternion zero", "refused", lambda: refused("quats", 0.0), "quaternion zero"),
    word_case("quaternion NaN", "refused", lambda: refused("quats", np.nan), "quaternion not finite"),
    word_case("mean NaN", "refused", lambda: refused("means", np.nan), "mean not finite"),
    word_case("mean infinite", "refused", lambda: refused("means", np.inf), "mean not finite"),
    word_case("scale NaN", "refused", lambda: refused("log_scales", np.nan), "scale not finite"),
    word_case("scale infinite", "refused", lambda: refused("log_scales", np.inf), "scale not finite"),
    word_case("opacity NaN", "refused", lambda: refused("opacity_logits", np.nan), "opacity not a number"),
    word_case("SH NaN", "refused", lambda: refused("sh", np.nan), "colour not finite"),
    word_case("SH infinite", "refused", lambda: refused("sh", -np.inf), "colour not finite"),
    word_case("file with one of every fault", "the others are read, the faults counted by reason", dropped,
              f"{COUNT - 5} kept; colour not finite 1, mean not finite 1, opacity not a number 1, quaternion zero 1, "
              "scale not finite 1"),
    word_case("opacities stored activated", "read with a warning", unactivated, "warned"),
    word_case("distorted intrinsics", "refused: undistort first", distorted, "refused"),
)  # fmt: skip
