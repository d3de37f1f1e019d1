"""Zstandard streams through pyarrow's codec, so that no other package is needed for them."""

from __future__ import annotations

from schemas.errors import InputError

MAX_RATIO = 1 << 17
"""Zstandard's own limit: a 128 KiB block may be stored as one repeated byte. More is a lie in the header."""


def unzstd(data: bytes, size: int, subject: object, field: str) -> bytes:
    """Return the `size` bytes a Zstandard stream holds.

    Args:
        data: The compressed stream.
        size: Bytes it must decompress to.
        subject: File, for the message.
        field: What the stream holds, for the message.

    Raises:
        InputError: The stream is corrupt or holds another number of bytes.
    """
    import pyarrow as pa

    expected = f"a Zstandard stream of {size} bytes"
    if size > (len(data) + 1) * MAX_RATIO:
        raise InputError(subject, field=field, expected=expected, found=f"{len(data)} compressed bytes")
    try:
        return bytes(pa.decompress(data, decompressed_size=size, codec="zstd", asbytes=True)) if size else b""
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        raise InputError(subject, field=field, expected=expected, found=error) from error
