"""Zstandard streams: right size or an InputError."""

from __future__ import annotations

import pyarrow as pa
import pytest

from schemas.compression import unzstd
from schemas.errors import InputError

DATA = bytes(range(256)) * 20
PACKED = pa.compress(DATA, codec="zstd", asbytes=True)


def test_stream_gives_its_bytes() -> None:
    assert unzstd(PACKED, len(DATA), "a.spz", "positions") == DATA
    assert unzstd(b"", 0, "a.spz", "sh") == b""


@pytest.mark.parametrize("size", [len(DATA) - 1, len(DATA) + 1, 1 << 60])
def test_other_size_is_an_input_error_that_names_the_stream(size: int) -> None:
    with pytest.raises(InputError, match=rf"a\.spz: positions: expected a Zstandard stream of {size} bytes"):
        unzstd(PACKED, size, "a.spz", "positions")


def test_damaged_stream_is_an_input_error() -> None:
    for data in (PACKED[:-1], b"\0" + PACKED[1:], b""):
        with pytest.raises(InputError):
            unzstd(data, len(DATA), "a.spz", "positions")
