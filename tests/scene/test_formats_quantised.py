"""Compressed PLY, SPZ, SOG, .splat and .ksplat: against encoders written apart, other readers and each other."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from pipeline.geometry import quats_to_rotations
from pipeline.scene import Gaussians
from pipeline.scene.formats import load_gaussians, read_gaussians
from pipeline.scene.formats.raw import logits_of_bytes
from schemas.errors import InputError
from tests.scene.making import C0, opacity_bytes, random_gaussians, sog, sog_bundle, spz, webp, zipped

OPACITY_STEP = 0.51 / 255
"""Opacities are rounded to 1/255."""


def write(folder: Path, data: bytes, name: str) -> str:
    path = folder / name
    path.write_bytes(data)
    return str(path)


def opacities(gaussians: Gaussians) -> np.ndarray:
    return 1 / (1 + np.exp(-gaussians.opacity_logits.astype(float)))


def angles_deg(a: Gaussians, b: Gaussians) -> np.ndarray:
    turns = np.swapaxes(quats_to_rotations(a.quats), 1, 2) @ quats_to_rotations(b.quats)
    return np.degrees(np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1)))


def assert_near(read: Gaussians, made: Gaussians, *, mean: float, scale: float, dc: float, rest: float, angle: float):
    np.testing.assert_allclose(read.means, made.means, atol=mean)
    np.testing.assert_allclose(read.log_scales, made.log_scales, atol=scale)
    np.testing.assert_allclose(opacities(read), opacities(made), atol=OPACITY_STEP)
    np.testing.assert_allclose(read.sh[:, 0], made.sh[:, 0], atol=dc)
    np.testing.assert_allclose(read.sh[:, 1:], made.sh[:, 1:], atol=rest)
    assert angles_deg(read, made).max() < angle


def test_stored_opacities_become_logits_with_both_ends_exact() -> None:
    logits = logits_of_bytes(np.arange(256, dtype=np.uint8))
    assert logits[0] == -np.inf
    assert logits[255] == np.inf
    np.testing.assert_allclose(1 / (1 + np.exp(-logits.astype(float))), np.arange(256) / 255, atol=1e-7)


class TestSpz:
    # 12 bits of fraction; 1/16 log scale; 0.15 x 255 steps a unit of colour; 1/128 a unit of the rest.
    # Up to version 2, w is the root of what three bytes leave of 1: at w near 0 half a step is up to 18 degrees.
    STEPS = {"mean": 0.51 / 4096, "scale": 0.51 / 16, "dc": 0.51 / (0.15 * 255), "rest": 0.51 / 128}

    @pytest.mark.parametrize("degree", [0, 1, 2, 3])
    @pytest.mark.parametrize(("version", "angle"), [(2, 18.0), (3, 0.3)])
    def test_gzipped_versions_read_to_quantisation_in_ply_axes(
        self, tmp_path: Path, degree: int, version: int, angle: float
    ) -> None:
        made = random_gaussians(degree=degree)
        read = load_gaussians(write(tmp_path, spz(made, version), "a.spz"))
        assert_near(read, made, **self.STEPS, angle=angle)

    def test_version_1_with_half_floats_reads(self, tmp_path: Path) -> None:
        made = random_gaussians(degree=1)
        read = load_gaussians(write(tmp_path, spz(made, 1), "a.spz"))
        assert_near(read, made, **{**self.STEPS, "mean": 2e-3}, angle=18.0)

    def test_bare_bytes_read_like_the_gzipped_ones(self, tmp_path: Path) -> None:
        made = random_gaussians(degree=2)
        packed = load_gaussians(write(tmp_path, spz(made), "a.spz"))
        bare = load_gaussians(write(tmp_path, spz(made, compress=False), "b.spz"))
        assert packed.sh.tobytes() == bare.sh.tobytes()
        assert packed.means.tobytes() == bare.means.tobytes()

    @pytest.mark.parametrize("degree", [0, 3])
    def test_version_4_reads_like_version_3(self, tmp_path: Path, degree: int) -> None:
        made = random_gaussians(degree=degree)
        old = spz(made, 3, compress=False)
        three = load_gaussians(write(tmp_path, old, "a.spz"))
        four = load_gaussians(write(tmp_path, version_4(old), "b.spz"))
        for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
            np.testing.assert_array_equal(getattr(three, name), getattr(four, name))

    def test_degree_4_loses_its_last_band_with_a_warning(self, tmp_path: Path) -> None:
        made = random_gaussians(6, degree=3)
        data = bytearray(spz(made, 3, compress=False))
        data[12] = 4
        rest = np.frombuffer(bytes(data[-6 * 45 :]), np.uint8).reshape(6, 15, 3)
        wider = np.concatenate([rest, np.full((6, 9, 3), 7, np.uint8)], axis=1)
        file = read_gaussians(write(tmp_path, bytes(data[: -6 * 45]) + wider.tobytes(), "a.spz"))
        assert_near(file.gaussians, made, **self.STEPS, angle=0.3)
        assert any("degree 4" in line for line in file.warnings)

    @pytest.mark.parametrize(
        ("at", "value", "field"), [(4, 9, "version"), (12, 5, "sh_degree"), (13, 31, "fractional_bits")]
    )
    def test_unknown_header_values_are_named(self, tmp_path: Path, at: int, value: int, field: str) -> None:
        data = bytearray(spz(random_gaussians(4), compress=False))
        data[at] = value
        with pytest.raises(InputError) as caught:
            load_gaussians(write(tmp_path, bytes(data), "a.spz"))
        assert caught.value.field == field

    def test_gzip_bomb_header_is_refused_without_unpacking_it(self, tmp_path: Path) -> None:
        data = bytearray(spz(random_gaussians(4), compress=False))
        data[8:12] = b"\xff\xff\xff\xff"
        import gzip

        with pytest.raises(InputError, match="bytes in the gzip stream"):
            load_gaussians(write(tmp_path, gzip.compress(bytes(data)), "a.spz"))

    def test_same_object_as_ply_and_spz_agrees_to_quantisation(self, shared_data: Path) -> None:
        folder = shared_data / "splat_files"
        a, b = load_gaussians(str(folder / "biker.compressed.ply")), load_gaussians(str(folder / "biker.spz"))
        assert len(a) == len(b) == 152_746
        # Half a step of SPZ, plus the PLY's own step: its chunks span about 0.3 m in 1023 steps.
        np.testing.assert_allclose(a.means, b.means, atol=0.5 / 4096 + 2e-4)
        np.testing.assert_allclose(np.maximum(a.log_scales, -10), b.log_scales, atol=0.5 / 16 + 2e-3)
        np.testing.assert_allclose(opacities(a), opacities(b), atol=1e-6)
        np.testing.assert_allclose(a.sh, b.sh, atol=0.51 / (0.15 * 255))
        assert angles_deg(a, b).max() < 0.3

    @pytest.mark.parametrize("name", ["minimal-v3.spz", "minimal-v4.spz"])
    def test_minimal_files_agree_with_the_same_object_in_other_formats(self, shared_data: Path, name: str) -> None:
        folder = shared_data / "splat_files"
        spz_file, splat_file = load_gaussians(str(folder / name)), load_gaussians(str(folder / "minimal.splat"))
        np.testing.assert_allclose(spz_file.means, splat_file.means, atol=1e-6)
        np.testing.assert_allclose(spz_file.sh, splat_file.sh, atol=0.51 / (0.15 * 255))

    def test_another_reader_sees_the_same_numbers_before_the_turn(self, tmp_path: Path) -> None:
        gsply = pytest.importorskip("gsply")
        path = write(tmp_path, spz(random_gaussians(degree=2)), "a.spz")
        theirs, ours = gsply.read_spz(path), load_gaussians(path)
        np.testing.assert_allclose(ours.means * (1, -1, -1), theirs.means, atol=1e-6)
        np.testing.assert_allclose(ours.log_scales, theirs.scales, atol=1e-6)
        np.testing.assert_allclose(np.abs(ours.quats), np.abs(theirs.quats), atol=1e-6)
        np.testing.assert_allclose(np.abs(ours.sh[:, 1:]), np.abs(theirs.shN), atol=1e-6)


def version_4(bare: bytes) -> bytes:
    import pyarrow as pa

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


class TestCompressedPly:
    # The widest chunk axis spans about 6 m in 1023 steps; log scales 5 in 1023; coefficients 8 in 256.
    STEPS = {"mean": 6 / 1023, "scale": 5 / 1023, "dc": 0.006, "rest": 4 / 256, "angle": 0.25}

    @pytest.mark.parametrize("degree", [0, 1, 2, 3])
    def test_reads_what_an_encoder_written_apart_made(self, tmp_path: Path, degree: int) -> None:
        made = random_gaussians(300, degree=degree)
        file = read_gaussians(write(tmp_path, compressed_ply(made), "a.ply"))
        assert file.format == "compressed ply"
        assert_near(file.gaussians, made, **self.STEPS)

    @pytest.mark.parametrize("degree", [0, 2])
    def test_another_reader_agrees(self, tmp_path: Path, degree: int) -> None:
        gsply = pytest.importorskip("gsply")
        path = write(tmp_path, compressed_ply(random_gaussians(300, degree=degree)), "a.ply")
        assert_same_as_gsply(load_gaussians(path), gsply.plyread(path))

    @pytest.mark.parametrize("name", ["biker.compressed.ply", "guitar.compressed.ply"])
    def test_another_reader_agrees_on_real_files(self, shared_data: Path, name: str) -> None:
        gsply = pytest.importorskip("gsply")
        path = shared_data / "splat_files" / name
        assert_same_as_gsply(load_gaussians(str(path)), gsply.plyread(path))

    def test_real_file_decoded_by_hand(self, shared_data: Path) -> None:
        data = (shared_data / "splat_files" / "guitar.compressed.ply").read_bytes()
        read = load_gaussians(str(shared_data / "splat_files" / "guitar.compressed.ply"))
        body = data.index(b"end_header\n") + len(b"end_header\n")
        for i in (0, 255, 256, 90_853):
            chunk = struct.unpack_from("<18f", data, body + 72 * (i // 256))
            position, _, scale, color = struct.unpack_from("<4I", data, body + 72 * 355 + 16 * i)
            parts = [(position >> 21) / 2047, (position >> 11 & 1023) / 1023, (position & 2047) / 2047]
            mean = [low + (high - low) * part for low, high, part in zip(chunk[0:3], chunk[3:6], parts, strict=True)]
            np.testing.assert_allclose(read.means[i], mean, atol=1e-5)
            size = chunk[6] + (chunk[9] - chunk[6]) * (scale >> 21) / 2047
            assert read.log_scales[i, 0] == pytest.approx(size, abs=1e-5)
            red = chunk[12] + (chunk[15] - chunk[12]) * (color >> 24) / 255
            assert 0.5 + C0 * read.sh[i, 0, 0] == pytest.approx(red, abs=1e-5)
            assert opacities(read)[i] == pytest.approx((color & 255) / 255, abs=1e-6)

    def test_too_few_chunks_is_an_input_error(self, tmp_path: Path) -> None:
        data = compressed_ply(random_gaussians(300, degree=0)).replace(b"element chunk 2", b"element chunk 1")
        with pytest.raises(InputError, match="chunk: expected 2 chunks for 300 vertices, found 1"):
            load_gaussians(write(tmp_path, data, "a.ply"))

    @pytest.mark.parametrize(
        ("old", "new", "field"),
        [
            (b"property uint packed_scale", b"property uint packed_stale", "packed_scale"),
            (b"property float max_scale_y", b"property float max_stale_y", "max_scale_y"),
            (b"property uchar f_rest_3", b"property uchar f_west_3", "sh"),
            (b"element sh 300", b"element sh 299", "sh"),
        ],
    )
    def test_missing_part_is_named(self, tmp_path: Path, old: bytes, new: bytes, field: str) -> None:
        data = compressed_ply(random_gaussians(300, degree=1))
        assert old in data
        with pytest.raises(InputError) as caught:
            load_gaussians(write(tmp_path, data.replace(old, new), "a.ply"))
        assert caught.value.field == field


def assert_same_as_gsply(ours: Gaussians, theirs) -> None:
    np.testing.assert_allclose(ours.means, theirs.means, atol=1e-5)
    np.testing.assert_allclose(ours.log_scales, theirs.scales, atol=1e-5)
    np.testing.assert_allclose(ours.quats, theirs.quats, atol=1e-5)
    np.testing.assert_allclose(ours.sh[:, 0], theirs.sh0, atol=1e-5)
    np.testing.assert_allclose(ours.sh[:, 1:], theirs.shN, atol=1e-5)
    # It stands in logits of 10 for opacities of exactly 0 and 1; ours are infinite.
    inside = np.isfinite(ours.opacity_logits)
    np.testing.assert_allclose(ours.opacity_logits[inside], theirs.opacities[inside], atol=1e-4)
    assert (np.abs(theirs.opacities[~inside]) == 10).all()


class TestSog:
    # Means: 16 bits over the log range; the rest: 8 bits of ranges of about 5, 8 (logits) and 1.8.
    STEPS = {"mean": 3e-3, "scale": 0.02, "dc": 0.01, "rest": 0.01, "angle": 1.5}

    @pytest.mark.parametrize("degree", [0, 1, 2, 3])
    def test_version_2_reads_to_quantisation(self, tmp_path: Path, degree: int) -> None:
        made = random_gaussians(degree=degree)
        file = read_gaussians(write(tmp_path, sog_bundle(made), "a.sog"))
        assert file.format == "sog"
        assert_near(file.gaussians, made, **self.STEPS)

    @pytest.mark.parametrize("degree", [0, 3])
    def test_version_1_reads_to_quantisation(self, tmp_path: Path, degree: int) -> None:
        made = random_gaussians(degree=degree)
        read = load_gaussians(write(tmp_path, sog_bundle(made, version=1), "a.sog"))
        np.testing.assert_allclose(read.opacity_logits, made.opacity_logits, atol=8 / 255)
        np.testing.assert_allclose(read.means, made.means, atol=3e-3)
        np.testing.assert_allclose(read.sh, made.sh, atol=0.01)

    def test_folder_reads_like_the_bundle(self, tmp_path: Path) -> None:
        made = random_gaussians(degree=1)
        for name, data in sog(made).items():
            write(tmp_path, data, name)
        folder = load_gaussians(str(tmp_path / "meta.json"))
        bundle = load_gaussians(write(tmp_path, sog_bundle(made), "a.sog"))
        assert folder.sh.tobytes() == bundle.sh.tobytes()
        assert folder.means.tobytes() == bundle.means.tobytes()

    def test_palette_wider_than_a_row_reads(self, tmp_path: Path) -> None:
        made = random_gaussians(200, degree=1)
        read = load_gaussians(write(tmp_path, sog_bundle(made), "a.sog"))
        np.testing.assert_allclose(read.sh, made.sh, atol=0.01)

    @pytest.mark.parametrize("name", ["meta.json", "l.webp", "q.webp", "c.webp"])
    def test_missing_member_is_named(self, tmp_path: Path, name: str) -> None:
        files = sog(random_gaussians(degree=0))
        del files[name]
        with pytest.raises(InputError) as caught:
            load_gaussians(write(tmp_path, zipped(files), "a.sog"))
        assert caught.value.field == name

    def test_names_outside_the_folder_are_refused(self, tmp_path: Path) -> None:
        files = sog(random_gaussians(degree=0))
        files["meta.json"] = files["meta.json"].replace(b"l.webp", b"../l.webp")
        with pytest.raises(InputError, match="beside meta.json"):
            load_gaussians(write(tmp_path, zipped(files), "a.sog"))

    def test_lossy_image_is_refused(self, tmp_path: Path) -> None:
        files = sog(random_gaussians(degree=0))
        files["s.webp"] = webp(np.random.default_rng(0).integers(0, 255, (40, 3)), lossless=False)
        with pytest.raises(InputError, match="s.webp: expected lossless WebP"):
            load_gaussians(write(tmp_path, zipped(files), "a.sog"))

    def test_image_too_small_for_the_count_is_refused(self, tmp_path: Path) -> None:
        files = sog(random_gaussians(degree=0))
        files["s.webp"] = webp(np.zeros((8, 3)))
        with pytest.raises(InputError, match="scales: expected at least 40 pixels, found 8"):
            load_gaussians(write(tmp_path, zipped(files), "a.sog"))

    @pytest.mark.parametrize(
        "broken",
        [b"[]", b"{}", b"{", b'{"version": 3}', b'{"version": 2, "count": "many"}', b'{"version": 2, "count": 4}'],
    )
    def test_broken_meta_is_an_input_error(self, tmp_path: Path, broken: bytes) -> None:
        files = {**sog(random_gaussians(degree=0)), "meta.json": broken}
        with pytest.raises(InputError):
            load_gaussians(write(tmp_path, zipped(files), "a.sog"))


def splat(gaussians: Gaussians) -> bytes:
    out = b""
    for i in range(len(gaussians)):
        rgb = np.clip(np.round((0.5 + C0 * gaussians.sh[i, 0].astype(float)) * 255), 0, 255).astype(np.uint8)
        quat = np.clip(np.round(gaussians.quats[i].astype(float) * 128 + 128), 0, 255).astype(np.uint8)
        out += gaussians.means[i].tobytes() + np.exp(gaussians.log_scales[i]).tobytes() + rgb.tobytes()
        out += bytes([opacity_bytes(gaussians)[i]]) + quat.tobytes()
    return out


class TestSplat:
    def test_reads_what_an_encoder_written_apart_made(self, tmp_path: Path) -> None:
        made = random_gaussians(degree=0)
        read = load_gaussians(write(tmp_path, splat(made), "a.splat"))
        assert_near(read, made, mean=0, scale=1e-5, dc=0.51 / 255 / C0, rest=0, angle=1.0)

    def test_scale_of_zero_is_a_flat_axis_and_a_negative_one_is_dropped(self, tmp_path: Path) -> None:
        data = bytearray(splat(random_gaussians(4, degree=0)))
        data[12:16] = struct.pack("<f", 0.0)
        data[32 + 12 : 32 + 16] = struct.pack("<f", -1.0)
        file = read_gaussians(write(tmp_path, bytes(data), "a.splat"))
        assert file.gaussians.log_scales[0, 0] == -np.inf
        assert file.dropped == {"scale not finite": 1}

    def test_length_of_no_whole_rows_is_an_input_error(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="multiple of 32 bytes, found 127 bytes"):
            load_gaussians(write(tmp_path, splat(random_gaussians(4, degree=0))[:-1], "a.splat"))


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


class TestKsplat:
    @pytest.mark.parametrize("degree", [0, 1, 2])
    @pytest.mark.parametrize("level", [0, 1, 2])
    def test_every_level_and_degree_reads_to_quantisation(self, tmp_path: Path, level: int, degree: int) -> None:
        made = random_gaussians(37, degree=degree)
        file = read_gaussians(write(tmp_path, ksplat(made, level), "a.ksplat"))
        assert file.format == "ksplat"
        rest = {0: 1e-6, 1: 1e-3, 2: 0.51 / 127}[level]
        assert_near(file.gaussians, made, mean=2e-4, scale=2e-2, dc=0.51 / 255 / C0, rest=rest, angle=0.2)

    def test_minimal_file_agrees_with_the_same_object_as_splat(self, shared_data: Path) -> None:
        folder = shared_data / "splat_files"
        a, b = load_gaussians(str(folder / "minimal.ksplat")), load_gaussians(str(folder / "minimal.splat"))
        np.testing.assert_array_equal(a.means, b.means)
        np.testing.assert_array_equal(a.sh, b.sh)
        np.testing.assert_array_equal(a.log_scales, b.log_scales)

    @pytest.mark.parametrize(
        ("at", "form", "value", "field"),
        [
            (0, "B", 7, "version"),
            (20, "H", 3, "compression level"),
            (4, "I", 4_000_000_000, "sections"),
            (4, "I", 0, "sections"),
            (4096, "I", 4_000_000_000, "section"),
            (4096 + 12, "I", 4_000_000_000, "section"),
            (4096 + 20, "H", 8, "bucket size"),
            (4096 + 32, "I", 0, "buckets"),
            (4096 + 40, "H", 9, "sh degree"),
        ],
    )
    def test_inconsistent_header_is_named(self, tmp_path: Path, at: int, form: str, value: int, field: str) -> None:
        data = bytearray(ksplat(random_gaussians(37, degree=0), 1))
        struct.pack_into("<" + form, data, at, value)
        with pytest.raises(InputError) as caught:
            load_gaussians(write(tmp_path, bytes(data), "a.ksplat"))
        assert caught.value.field == field
