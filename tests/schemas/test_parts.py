from __future__ import annotations

import hashlib
import itertools
import random
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas import parts
from schemas.answers import ANSWERS, AnswerRow
from schemas.errors import InputError
from schemas.parts import decode_part, encode_part, write_stream
from tests.workers.fake_steps import answer, unit

FLIPS = 60
"""Single-bit flips tried: as many as showed that unchecked reading lets most of them through."""


def rows(count: int) -> list[AnswerRow]:
    return [
        answer(question, answer=f"answer {i} " + "x" * (i % 7), evidence=("chair",) * (i % 3))
        for i, question in enumerate(unit(0, ["q"] * count).questions)
    ]


def test_same_rows_give_the_same_bytes_and_come_back() -> None:
    data = encode_part(ANSWERS, rows(50))
    assert data == encode_part(ANSWERS, rows(50))
    assert ANSWERS.to_rows(decode_part(ANSWERS, data, "part")) == rows(50)


def test_flipped_bit_is_never_read_as_a_value() -> None:
    data, good, draw = encode_part(ANSWERS, rows(200)), rows(200), random.Random(0)
    refused = 0
    for _ in range(FLIPS):
        flipped = bytearray(data)
        flipped[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        try:
            table = decode_part(ANSWERS, bytes(flipped), "part")
        except InputError:
            refused += 1
        else:
            # Bits outside the data, such as in statistics, may change; no value may.
            assert ANSWERS.to_rows(table) == good
    assert refused > FLIPS / 2


def test_flipped_bit_is_refused_by_the_hash() -> None:
    data = bytearray(encode_part(ANSWERS, rows(5)))
    sha256 = hashlib.sha256(data).hexdigest()
    data[100] ^= 1
    with pytest.raises(InputError, match=f"part: sha256: expected {sha256}, as its manifest says"):
        decode_part(ANSWERS, bytes(data), "part", sha256)


@pytest.mark.parametrize("data", [b"", b"PAR1", b"not parquet at all"], ids=["empty", "magic only", "text"])
def test_bytes_that_are_no_parquet_are_refused_in_one_line(data: bytes) -> None:
    with pytest.raises(InputError, match="part: expected a readable Parquet file") as caught:
        decode_part(ANSWERS, data, "part")
    assert "\n" not in str(caught.value)


@settings(max_examples=25, deadline=None)
@given(cuts=st.lists(st.integers(0, 40), max_size=6))
def test_streamed_file_does_not_depend_on_how_rows_were_cut(
    cuts: list[int], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder, whole = tmp_path_factory.mktemp("stream"), ANSWERS.to_arrow(rows(40))
    places = [0, *sorted(cuts), 40]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "ROW_GROUP_ROWS", 16)
        pieces = [whole.slice(a, b - a) for a, b in itertools.pairwise(places)]
        assert write_stream(ANSWERS, pieces, folder / "cut.parquet") == 40
        write_stream(ANSWERS, [whole], folder / "whole.parquet")
    assert (folder / "cut.parquet").read_bytes() == (folder / "whole.parquet").read_bytes()
    metadata = pq.read_metadata(folder / "cut.parquet")
    assert [metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)] == [16, 16, 8]


def test_stream_that_breaks_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "results" / "answers.parquet"
    write_stream(ANSWERS, [ANSWERS.to_arrow(rows(3))], path)
    before = path.read_bytes()

    def broken() -> object:
        yield ANSWERS.to_arrow(rows(5))
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        write_stream(ANSWERS, broken(), path)  # type: ignore[arg-type]
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["answers.parquet"]


def test_stream_of_no_rows_is_a_file_with_the_schema(tmp_path: Path) -> None:
    assert write_stream(ANSWERS, [], tmp_path / "empty.parquet") == 0
    found = pq.read_table(tmp_path / "empty.parquet")
    assert isinstance(found, pa.Table)
    ANSWERS.check(found.schema, "empty")
