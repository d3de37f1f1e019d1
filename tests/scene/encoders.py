"""Encoders of splat files, written apart from the readers they test: one Gaussian at a time where that is plainer."""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile

import numpy as np
import pyarrow as pa

from pipeline.scene import Gaussians

C0 = 0.5 / np.sqrt(np.pi)


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


def version_4(bare: bytes) -> bytes:
    """The bare bytes of an SPZ of version 3, as version 4: a Zstandard stream an attribute."""
    count, degree, bits = struct.unpack_from("<IBB", bare, 8)
    sizes = [9 * count, count, 3 * count, 3 * count, 4 * count, 3 * count * ((degree + 1) ** 2 - 1)]
    parts, at = [], 16
    for size in filter(None, sizes):
        parts.append(bare[at : at + size])
        at += size
    packed = [pa.compress(part, codec="zstd", asbytes=True) for part in parts]
    head = b"NGSP" + struct.pack("<IIBBBBI", 4, count, degree, bits, 0, len(parts), 32) + bytes(12)
    table = b"".join(struct.pack("<QQ", len(a), len(b)) for a, b in zip(packed, parts, strict=True))
    return head + table + b"".join(packed)


def compressed_ply(gaussians: Gaussians) -> bytes:
    """Chunks of 256, one Gaussian at a time."""
    count = len(gaussians)
    rgb = 0.5 + C0 * gaussians.sh[:, 0].astype(float)
    names = [
        f"{m}_{p}{a}" for p, axes in (("", "xyz"), ("scale_", "xyz"), ("", "rgb")) for m in ("min", "max") for a in axes
    ]
    groups = [gaussians.means.astype(float), gaussians.log_scales.astype(float), rgb]
    bounds, rows = b"", b""
    for start in range(0, count, 256):
        part = slice(start, min(start + 256, count))
        lows = [group[part].min(axis=0) for group in groups]
        highs = [group[part].max(axis=0) + 1e-3 for group in groups]
        for low, high in zip(lows, highs, strict=True):
            bounds += np.concatenate([low, high]).astype("<f4").tobytes()
        for i in range(part.start, part.stop):
            unit = [(group[i] - low) / (high - low) for group, low, high in zip(groups, lows, highs, strict=True)]
            quat = gaussians.quats[i].astype(float)
            largest = int(np.argmax(np.abs(quat)))
            a, b, c = np.delete(quat * np.sign(quat[largest]), largest) / np.sqrt(2) + 0.5
            red, green, blue = np.round(unit[2] * 255).astype(int)
            rotation = largest << 30 | round(a * 1023) << 20 | round(b * 1023) << 10 | round(c * 1023)
            color = int(red) << 24 | int(green) << 16 | int(blue) << 8 | int(opacity_bytes(gaussians)[i])
            rows += struct.pack("<IIII", _point(unit[0]), rotation, _point(unit[1]), color)
    header = ["ply", "format binary_little_endian 1.0", f"element chunk {-(-count // 256)}"]
    header += [f"property float {name}" for name in names] + [f"element vertex {count}"]
    header += [f"property uint packed_{name}" for name in ("position", "rotation", "scale", "color")]
    sh = b""
    if rest := gaussians.sh.shape[1] - 1:
        header += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(3 * rest))]
        codes = np.floor((gaussians.sh[:, 1:].transpose(0, 2, 1).astype(float) / 8 + 0.5) * 256)
        sh = codes.astype(np.uint8).tobytes()
    return "\n".join([*header, "end_header", ""]).encode() + bounds + rows + sh


def _point(unit: np.ndarray) -> int:
    x, y, z = unit
    return round(x * 2047) << 21 | round(y * 1023) << 11 | round(z * 2047)


def splat(gaussians: Gaussians) -> bytes:
    out = b""
    for i in range(len(gaussians)):
        rgb = np.clip(np.round((0.5 + C0 * gaussians.sh[i, 0].astype(float)) * 255), 0, 255).astype(np.uint8)
        quat = np.clip(np.round(gaussians.quats[i].astype(float) * 128 + 128), 0, 255).astype(np.uint8)
        out += gaussians.means[i].tobytes() + np.exp(gaussians.log_scales[i]).tobytes() + rgb.tobytes()
        out += bytes([opacity_bytes(gaussians)[i]]) + quat.tobytes()
    return out


def ksplat(gaussians: Gaussians, level: int, bucket_size: int = 8) -> bytes:
    """One section; at levels 1 and 2 every bucket is a full one but the last two."""
    count, rest, steps = len(gaussians), gaussians.sh.shape[1] - 1, 1 if level == 0 else 32767
    tail = [count % bucket_size or bucket_size, 0] if level else []
    full = (count - sum(tail)) // bucket_size if level else 0
    buckets = full + len(tail)
    block = 20.0
    centers = np.random.default_rng(5).normal(size=(buckets, 3)).astype(np.float32)
    section = bytearray(1024)
    struct.pack_into("<IIIIfH", section, 0, count, count, bucket_size, buckets, block, 12 if level else 0)
    struct.pack_into("<I", section, 24, steps if level else 0)
    struct.pack_into("<IIH", section, 32, full, len(tail), gaussians.sh_degree)
    header = bytearray(4096)
    struct.pack_into("<BBxxIIIIH", header, 0, 0, 1, 1, 1, count, count, level)
    struct.pack_into("<ff", header, 36, -1.0, 1.0)
    out = bytes(header) + bytes(section) + b"".join(struct.pack("<I", length) for length in tail) + centers.tobytes()
    for i in range(count):
        kind = np.float32 if level == 0 else np.float16
        if level == 0:
            out += gaussians.means[i].tobytes()
        else:
            offset = gaussians.means[i].astype(float) - centers[i // bucket_size]
            out += np.round(offset / (block / 2) * steps + steps).astype("<u2").tobytes()
        rgb = np.clip(np.round((0.5 + C0 * gaussians.sh[i, 0].astype(float)) * 255), 0, 255).astype(np.uint8)
        out += np.exp(gaussians.log_scales[i]).astype(kind).tobytes() + gaussians.quats[i].astype(kind).tobytes()
        out += rgb.tobytes() + bytes([opacity_bytes(gaussians)[i]])
        coefficients = [gaussians.sh[i, a:b].T.reshape(-1) for a, b in ((1, 4), (4, 9)) if b <= rest + 1]
        values = np.concatenate(coefficients) if coefficients else np.empty(0)
        out += (np.round((values + 1) / 2 * 255).astype(np.uint8) if level == 2 else values.astype(kind)).tobytes()
    return out
