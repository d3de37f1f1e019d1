"""Small scenes and splat files for tests. The encoders here are written apart from the readers they test."""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile

import numpy as np

from pipeline.geometry import Camera, look_at
from pipeline.scene import Gaussians, Scene, Semantics, View

C0 = 0.5 / np.sqrt(np.pi)


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


def opacity_bytes(gaussians: Gaussians) -> np.ndarray:
    return np.round(255 / (1 + np.exp(-gaussians.opacity_logits.astype(float)))).astype(np.uint8)


def spz(gaussians: Gaussians, version: int = 3, fraction_bits: int = 12, *, compress: bool = True) -> bytes:
    """An SPZ of versions 1 to 3, one Gaussian at a time; the y and z axes are flipped as the format asks."""
    count, rest = len(gaussians), gaussians.sh.shape[1] - 1
    degree = gaussians.sh_degree
    out = {name: bytearray() for name in ("positions", "alphas", "colors", "scales", "rotations", "sh")}
    # Odd under (x, y, z) -> (x, -y, -z), written as the monomials of each basis function.
    odd = ["y", "z", "", "y", "yz", "", "z", "", "y", "yz", "y", "z", "", "z", ""]
    for i in range(count):
        x, y, z = gaussians.means[i].astype(float) * (1, -1, -1)
        for value in (x, y, z):
            if version == 1:
                out["positions"] += np.float16(value).tobytes()
            else:
                out["positions"] += struct.pack("<i", round(value * 2**fraction_bits))[:3]
        for value in gaussians.sh[i, 0]:
            out["colors"].append(int(np.clip(round((0.15 * float(value) + 0.5) * 255), 0, 255)))
        for value in gaussians.log_scales[i]:
            out["scales"].append(int(np.clip(round((float(value) + 10) * 16), 0, 255)))
        for k in range(rest):
            sign = (-1) ** len(odd[k])
            for value in gaussians.sh[i, 1 + k]:
                out["sh"].append(int(np.clip(round(sign * float(value) * 128) + 128, 0, 255)))
        out["rotations"] += _spz_rotation(gaussians.quats[i].astype(float) * (1, 1, -1, -1), version)
    out["alphas"] += opacity_bytes(gaussians).tobytes()
    header = b"NGSP" + struct.pack("<IIBBBB", version, count, degree, fraction_bits, 0, 0)
    payload = header + b"".join(bytes(part) for part in out.values())
    return gzip.compress(payload) if compress else payload


def _spz_rotation(wxyz: np.ndarray, version: int) -> bytes:
    x, y, z, w = wxyz[1], wxyz[2], wxyz[3], wxyz[0]
    if version < 3:
        sign = 1 if w >= 0 else -1
        return bytes(int(np.clip(round((sign * value + 1) * 127.5), 0, 255)) for value in (x, y, z))
    parts = [x, y, z, w]
    largest = int(np.argmax(np.abs(parts)))
    flip = parts[largest] < 0
    packed = largest
    for i, value in enumerate(parts):
        if i != largest:
            magnitude = min(511, round(abs(value) * np.sqrt(2) * 511))
            packed = packed << 10 | ((value < 0) != flip) << 9 | magnitude
    return struct.pack("<I", packed)


def sog(gaussians: Gaussians, *, version: int = 2) -> dict[str, bytes]:
    """The files of a SOG folder: means in 16 bits, the rest in 8; version 1 has bounds, version 2 codebooks."""
    count, rest = len(gaussians), gaussians.sh.shape[1] - 1
    logs = np.sign(gaussians.means) * np.log1p(np.abs(gaussians.means.astype(float)))
    low, high = logs.min(axis=0), logs.max(axis=0)
    codes = np.round((logs - low) / (high - low) * 65535).astype(int)
    meta: dict[str, object] = {"means": {"mins": low.tolist(), "maxs": high.tolist(), "files": ["l.webp", "u.webp"]}}
    files = {"l.webp": webp(codes & 255), "u.webp": webp(codes >> 8), "q.webp": webp(_sog_rotations(gaussians.quats))}
    meta["quats"] = {"files": ["q.webp"]}
    scale_codes, scale_meta = _coded(gaussians.log_scales, version)
    files["s.webp"], meta["scales"] = webp(scale_codes), {**scale_meta, "files": ["s.webp"]}
    if version == 1:
        dc_codes, dc_meta = _coded(np.c_[gaussians.sh[:, 0], gaussians.opacity_logits], 1)
    else:
        dc_codes, dc_meta = _coded(gaussians.sh[:, 0], 2)
        dc_codes = np.c_[dc_codes, opacity_bytes(gaussians)]
    files["c.webp"], meta["sh0"] = webp(dc_codes), {**dc_meta, "files": ["c.webp"]}
    if rest:
        # One palette entry a Gaussian, 64 entries a row.
        palette_codes, palette_meta = _coded(gaussians.sh[:, 1:].reshape(-1, 1), version)
        rows = -(-count // 64)
        palette = np.zeros((rows * 64, rest, 3), int)
        palette[:count] = palette_codes.reshape(count, rest, 3)
        files["p.webp"] = webp(palette.reshape(rows, 64 * rest, 3))
        labels = np.arange(count)
        files["n.webp"] = webp(np.c_[labels & 255, labels >> 8, 0 * labels])
        if version == 1:
            palette_meta = {"mins": palette_meta["mins"][0], "maxs": palette_meta["maxs"][0]}
        meta["shN"] = {**palette_meta, "count": count, "bands": gaussians.sh_degree, "files": ["p.webp", "n.webp"]}
    if version == 1:
        meta["means"]["shape"] = [count, 3]
    else:
        meta |= {"version": 2, "count": count}
    return {"meta.json": json.dumps(meta).encode(), **files}


def sog_bundle(gaussians: Gaussians, *, version: int = 2) -> bytes:
    return zipped(sog(gaussians, version=version))


def zipped(files: dict[str, bytes]) -> bytes:
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return sink.getvalue()


def webp(pixels: np.ndarray, *, lossless: bool = True) -> bytes:
    """Rows of 3 or 4 channels as a WebP; a list of pixels is laid out 8 wide."""
    from PIL import Image

    if pixels.ndim == 2:
        rows = -(-len(pixels) // 8)
        grid = np.zeros((rows * 8, pixels.shape[1]), int)
        grid[: len(pixels)] = pixels
        pixels = grid.reshape(rows, 8, -1)
    sink = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(sink, "WEBP", lossless=lossless, exact=True)
    return sink.getvalue()


def _coded(values: np.ndarray, version: int) -> tuple[np.ndarray, dict[str, list[float]]]:
    values = values.astype(float)
    if version == 1:
        low, high = values.min(axis=0), values.max(axis=0)
        codes = np.round((values - low) / (high - low) * 255).astype(int)
        return codes, {"mins": low.tolist(), "maxs": high.tolist()}
    codebook = np.linspace(values.min(), values.max(), 256)
    return np.abs(values[..., None] - codebook).argmin(axis=-1), {"codebook": codebook.tolist()}


def _sog_rotations(quats: np.ndarray) -> np.ndarray:
    pixels = []
    for quat in quats.astype(float):
        largest = int(np.argmax(np.abs(quat)))
        others = np.delete(quat * np.sign(quat[largest]), largest)
        pixels.append([*np.round((others * np.sqrt(2) + 1) / 2 * 255).astype(int), 252 + largest])
    return np.array(pixels)
