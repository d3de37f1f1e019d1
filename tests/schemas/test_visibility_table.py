from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas import storage
from schemas.errors import InputError
from schemas.visibility_table import VisibilitySpace, read_rows, write_rows
from tests.conftest import ROOT

SPACE = VisibilitySpace("ab" * 16, 1000)


def key(number: int) -> str:
    return f"{number:064x}"


def row(number: int) -> np.ndarray:
    return np.arange(number, 1000, 7, dtype=np.int32)


def test_rows_come_back_mapped_and_read_only(tmp_path: Path) -> None:
    uri = write_rows(str(tmp_path), SPACE, {key(i): row(i) for i in range(5)})
    assert Path(uri).parent == tmp_path / SPACE.key
    found = read_rows(str(tmp_path), SPACE)
    assert found.damaged == {}
    assert sorted(found.ids) == [key(i) for i in range(5)]
    for i in range(5):
        np.testing.assert_array_equal(found.ids[key(i)], row(i))
        assert not found.ids[key(i)].flags.writeable
        assert found.ids[key(i)].flags.aligned
    assert len({id(base(ids)) for ids in found.ids.values()}) == 1, "rows are pieces of one mapped file"


def base(array: np.ndarray) -> object:
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array.base


def test_order_of_rows_does_not_change_the_part(tmp_path: Path) -> None:
    first = write_rows(str(tmp_path), SPACE, {key(i): row(i) for i in range(5)})
    before = Path(first).stat().st_mtime_ns
    assert write_rows(str(tmp_path), SPACE, {key(i): row(i) for i in reversed(range(5))}) == first
    assert Path(first).stat().st_mtime_ns == before, "a part that is there is not written again"


def test_remote_store_gives_the_rows_and_tells_what_is_damaged() -> None:
    root = "mock:///visibility-table"
    uri = write_rows(root, SPACE, {key(1): row(1)})
    write_rows(root, SPACE, {key(2): row(2)})
    np.testing.assert_array_equal(read_rows(root, SPACE).ids[key(1)], row(1))
    storage.write_bytes_atomic(uri, b"else")
    found = read_rows(root, SPACE)
    assert list(found.ids) == [key(2)]
    assert list(found.damaged) == [uri]


def test_spaces_do_not_meet(tmp_path: Path) -> None:
    write_rows(str(tmp_path), SPACE, {key(1): row(1)})
    assert not read_rows(str(tmp_path), VisibilitySpace("cd" * 16, 1000)).ids


@settings(max_examples=30, deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), cut=st.booleans())
def test_any_flipped_bit_or_lost_end_is_found(
    tmp_path_factory: pytest.TempPathFactory, place: float, bit: int, cut: bool
) -> None:
    root = tmp_path_factory.mktemp("store")
    part = Path(write_rows(str(root), SPACE, {key(1): row(1), key(2): row(2)}))
    write_rows(str(root), SPACE, {key(3): row(3)})
    data = bytearray(part.read_bytes())
    at = int(place * len(data))
    if cut:
        del data[at:]
    else:
        data[at] ^= 1 << bit
    part.write_bytes(bytes(data))
    found = read_rows(str(root), SPACE)
    assert list(found.ids) == [key(3)]
    assert list(found.damaged) == [str(part)]


def test_part_of_another_space_or_with_ids_beyond_the_scene_is_refused(tmp_path: Path) -> None:
    smaller = VisibilitySpace(SPACE.key, 500)
    write_rows(str(tmp_path), SPACE, {key(1): row(1)})
    (message,) = read_rows(str(tmp_path), smaller).damaged.values()
    assert "schema" in message
    assert '"gaussians": 500' in message
    other = tmp_path / "other"
    write_rows(str(other), smaller, {key(1): row(1)})
    (message,) = read_rows(str(other), smaller).damaged.values()
    assert "ids" in message
    assert "expected 0 to 499" in message


def test_what_a_killed_writer_leaves_is_no_part(tmp_path: Path) -> None:
    part = Path(write_rows(str(tmp_path), SPACE, {key(1): row(1)}))
    part.with_name(f".{part.name}.0123.tmp").write_bytes(part.read_bytes()[:100])
    part.with_name("notes.txt").write_text("mine")
    found = read_rows(str(tmp_path), SPACE)
    assert list(found.ids) == [key(1)]
    assert found.damaged == {}


def test_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        write_rows(str(tmp_path / "file"), SPACE, {key(1): row(1)})


WRITER = """
import itertools, sys
import numpy as np
from schemas.visibility_table import VisibilitySpace, write_rows
for number in itertools.count(int(sys.argv[2]), int(sys.argv[3])):
    rows = {f"{number % 40:064x}": np.arange(number % 40, 2_000_000, 7, dtype=np.int32)}
    write_rows(sys.argv[1], VisibilitySpace("ab" * 16, 2_000_000), rows)
    print(number, flush=True)
"""


def test_killed_writers_beside_each_other_leave_a_usable_store(tmp_path: Path) -> None:
    space = VisibilitySpace(SPACE.key, 2_000_000)
    for _ in range(2):
        writers = [
            subprocess.Popen(
                [sys.executable, "-c", WRITER, str(tmp_path), *steps], cwd=ROOT, stdout=subprocess.PIPE, text=True
            )
            for steps in (("0", "1"), ("0", "3"))
        ]
        for writer in writers:
            assert writer.stdout is not None
            writer.stdout.readline()
        time.sleep(0.3)
        for writer in writers:
            os.kill(writer.pid, signal.SIGKILL)
            writer.communicate()
        found = read_rows(str(tmp_path), space)
        assert found.damaged == {}
        assert key(0) in found.ids
        for name, ids in found.ids.items():
            np.testing.assert_array_equal(ids, np.arange(int(name, 16), 2_000_000, 7))
    assert pa.total_allocated_bytes() < 1_000_000, "rows are mapped, not copied"
