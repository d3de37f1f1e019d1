"""Inria PLY: property order, encodings, extras, and one clear line for each thing that can be wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.scene import Gaussians
from pipeline.scene.formats import load_gaussians, read_gaussians, save_gaussians
from schemas.errors import InputError
from tests.scene.making import inria_columns, ply, random_gaussians

FIELDS = ("means", "quats", "log_scales", "opacity_logits", "sh")


def same_bits(a: Gaussians, b: Gaussians) -> bool:
    return all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in FIELDS)


def write(folder: Path, data: bytes, name: str = "a.ply") -> str:
    path = folder / name
    path.write_bytes(data)
    return str(path)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_save_then_load_gives_the_same_bits(tmp_path: Path, degree: int) -> None:
    made = random_gaussians(degree=degree)
    save_gaussians(made, str(tmp_path / "a.ply"))
    assert same_bits(load_gaussians(str(tmp_path / "a.ply")), made)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("form", ["binary_little_endian", "binary_big_endian", "ascii"])
def test_every_encoding_and_degree_reads_channel_major_coefficients(tmp_path: Path, degree: int, form: str) -> None:
    made = random_gaussians(degree=degree)
    assert same_bits(load_gaussians(write(tmp_path, ply(inria_columns(made), form=form))), made)


@settings(max_examples=25, deadline=None)
@given(st.randoms(use_true_random=False))
def test_any_property_order_with_extras_reads_the_same(tmp_path_factory: pytest.TempPathFactory, random) -> None:
    made = random_gaussians(12, degree=1)
    extras = {"nx": np.zeros(12), "red": np.arange(12), "time": np.linspace(0, 1, 12)}
    columns = list({**inria_columns(made), **extras}.items())
    random.shuffle(columns)
    data = ply(dict(columns), kinds={"red": "uchar", "time": "double", "x": "double", "rot_2": "float32"})
    assert same_bits(load_gaussians(write(tmp_path_factory.mktemp("p"), data)), made)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_line_ends_comments_and_elements_before_the_vertices_are_passed_over(tmp_path: Path, newline: str) -> None:
    made = random_gaussians(5, degree=0)
    before = "obj_info any words here\ncomment another\nelement camera 0\nproperty float f"
    data = ply(inria_columns(made), newline=newline, before=before)
    assert same_bits(load_gaussians(write(tmp_path, data)), made)


@pytest.mark.parametrize("field", ["x", "f_dc_1", "opacity", "scale_2", "rot_3"])
def test_missing_field_is_named_with_what_was_there(tmp_path: Path, field: str) -> None:
    columns = inria_columns(random_gaussians(5, degree=0))
    del columns[field]
    path = write(tmp_path, ply(columns))
    with pytest.raises(InputError) as caught:
        load_gaussians(path)
    assert (caught.value.subject, caught.value.field) == (path, field)
    assert "rot_0" in caught.value.found
    assert "\n" not in str(caught.value)


def test_rest_count_of_no_degree_is_an_input_error(tmp_path: Path) -> None:
    columns = inria_columns(random_gaussians(5, degree=1))
    del columns["f_rest_8"]
    with pytest.raises(InputError, match=r"f_rest: expected .* found 8 such"):
        load_gaussians(write(tmp_path, ply(columns)))


def test_numbering_gap_in_rest_is_an_input_error(tmp_path: Path) -> None:
    columns = inria_columns(random_gaussians(5, degree=1))
    columns["f_rest_9"] = columns.pop("f_rest_4")
    with pytest.raises(InputError, match="f_rest"):
        load_gaussians(write(tmp_path, ply(columns)))


def test_truncated_rows_say_how_many_there_are(tmp_path: Path) -> None:
    data = ply(inria_columns(random_gaussians(5, degree=0)))
    with pytest.raises(InputError, match="expected 5 rows of 56 bytes, found 4 rows"):
        load_gaussians(write(tmp_path, data[:-1]))


def test_count_beyond_any_memory_is_an_input_error(tmp_path: Path) -> None:
    data = ply(inria_columns(random_gaussians(5, degree=0)))
    with pytest.raises(InputError, match="rows"):
        load_gaussians(write(tmp_path, data.replace(b"element vertex 5", b"element vertex 5000000000000000")))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"format binary_little_endian", b"format binary_middle_endian"),
        (b"element vertex 5", b"element vertex five"),
        (b"element vertex 5", b"element vertex -5"),
        (b"property float x", b"property quad x"),
        (b"property float y", b"property float x"),
        (b"end_header", b"end_heade_"),
        (b"ply\n", b"plx\n"),
        (b"property float x", b"property list uchar int x"),
        (b"element vertex 5", b"element points 5"),
    ],
)
def test_broken_header_is_an_input_error(tmp_path: Path, old: bytes, new: bytes) -> None:
    data = ply(inria_columns(random_gaussians(5, degree=0)))
    assert old in data
    with pytest.raises(InputError):
        load_gaussians(write(tmp_path, data.replace(old, new, 1)))


def test_ascii_with_a_word_is_an_input_error(tmp_path: Path) -> None:
    data = ply(inria_columns(random_gaussians(5, degree=0)), form="ascii")
    with pytest.raises(InputError, match="expected numbers"):
        load_gaussians(write(tmp_path, data[:-3] + b"abc"))


def test_unusable_gaussians_are_dropped_and_counted_by_reason(tmp_path: Path) -> None:
    columns = {name: column.copy() for name, column in inria_columns(random_gaussians(20, degree=0)).items()}
    columns["x"][[1, 2]] = np.nan, np.inf
    columns["opacity"][[1, 5]] = np.nan
    for i in range(4):
        columns[f"rot_{i}"][7] = 0
    columns["scale_1"][9] = np.inf
    columns["scale_1"][10] = -np.inf
    columns["f_dc_2"][11] = np.nan
    file = read_gaussians(write(tmp_path, ply(columns)))
    assert file.dropped == {
        "mean not finite": 2,
        "quaternion zero": 1,
        "scale not finite": 1,
        "opacity not a number": 1,
        "colour not finite": 1,
    }
    assert np.flatnonzero(~file.kept).tolist() == [1, 2, 5, 7, 9, 11]
    assert len(file.gaussians) == 14
    assert any("dropped 2 Gaussians: mean not finite" in line for line in file.warnings)


def test_file_without_a_usable_gaussian_is_an_input_error(tmp_path: Path) -> None:
    columns = inria_columns(random_gaussians(5, degree=0))
    columns["x"] = np.full(5, np.nan)
    with pytest.raises(InputError, match="at least one usable Gaussian, found 5 dropped: mean not finite"):
        load_gaussians(write(tmp_path, ply(columns)))


def test_file_of_no_gaussians_is_an_input_error(tmp_path: Path) -> None:
    columns = {name: column[:0] for name, column in inria_columns(random_gaussians(5, degree=0)).items()}
    with pytest.raises(InputError, match="at least one usable"):
        load_gaussians(write(tmp_path, ply(columns)))


def test_opacities_and_scales_stored_activated_are_warned_of(tmp_path: Path) -> None:
    columns = inria_columns(random_gaussians(30, degree=0))
    assert not read_gaussians(write(tmp_path, ply(columns))).warnings
    columns["opacity"] = np.linspace(0, 1, 30)
    for i in range(3):
        columns[f"scale_{i}"] = np.exp(columns[f"scale_{i}"])
    lines = read_gaussians(write(tmp_path, ply(columns))).warnings
    assert len(lines) == 2
    assert "not logits" in lines[0]
    assert "not their logarithms" in lines[1]


def test_missing_file_and_folder_are_input_errors(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing there"):
        load_gaussians(str(tmp_path / "no.ply"))
    with pytest.raises(InputError, match="found a folder"):
        load_gaussians(str(tmp_path))


@pytest.mark.parametrize("name", ["a.pth", "a.ckpt", "a.npz", "a.txt", "a.ply"])
def test_other_files_are_refused_by_name_and_never_unpickled(tmp_path: Path, name: str) -> None:
    data = b"\x80\x04cos\nsystem\n" if name != "a.npz" else b"PK\x03\x04" + bytes(40)
    with pytest.raises(InputError, match="expected"):
        load_gaussians(write(tmp_path, data, name))


def test_real_inria_file_matches_another_reader(shared_data: Path) -> None:
    gsply = pytest.importorskip("gsply")
    path = shared_data / "splat_files" / "train-1000.ply"
    ours, theirs = load_gaussians(str(path)), gsply.plyread(path)
    assert ours.sh_degree == 3
    np.testing.assert_array_equal(ours.means, theirs.means)
    np.testing.assert_array_equal(ours.quats, theirs.quats)
    np.testing.assert_array_equal(ours.log_scales, theirs.scales)
    np.testing.assert_array_equal(ours.opacity_logits, theirs.opacities)
    np.testing.assert_array_equal(ours.sh[:, 0], theirs.sh0)
