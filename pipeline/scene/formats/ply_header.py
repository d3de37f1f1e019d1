"""PLY headers: which elements follow, with which properties, in which bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.scene.formats.raw import array_at
from schemas.errors import InputError

MAX_HEADER_BYTES = 1 << 20
"""No splat header comes near this; a longer search would only scan binary data."""

TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
}
"""NumPy type codes of PLY's scalar types, under both of their spellings."""

FORMATS: dict[str, Literal["<", ">", "ascii"]] = {
    "binary_little_endian": "<",
    "binary_big_endian": ">",
    "ascii": "ascii",
}


@dataclass(frozen=True, slots=True)
class Element:
    """One element of a PLY file."""

    name: str
    """Name, such as "vertex"."""
    count: int
    """Rows."""
    properties: tuple[tuple[str, str], ...]
    """(property name, NumPy type code) in file order; the type is "list" for a list property."""

    @property
    def names(self) -> tuple[str, ...]:
        """Property names in file order."""
        return tuple(name for name, _ in self.properties)


@dataclass(frozen=True, slots=True)
class Header:
    """A parsed PLY header."""

    encoding: Literal["<", ">", "ascii"]
    """Byte order of the data, or text."""
    elements: tuple[Element, ...]
    """Elements in file order."""
    data_start: int
    """Offset of the first data byte."""

    def element(self, name: str) -> Element | None:
        """Return the element of that name, or None."""
        return next((element for element in self.elements if element.name == name), None)


def parse_header(data: bytes, subject: object) -> Header:
    r"""Return the header of a PLY file.

    Line ends may be \n, \r\n or \r; comments and obj_info lines are passed over.

    Raises:
        InputError: The bytes are no PLY, the header has no end, or a line of it cannot be read.
    """
    head = data[:MAX_HEADER_BYTES]
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        found = "no end_header" if head.startswith(b"ply") else repr(data[:8])
        raise InputError(subject, expected='a PLY header ("ply" to "end_header")', found=found)
    start = end + len(b"end_header")
    # After a bare \r, a \n may already be data; only files whose other lines end in \r\n skip both.
    start += 2 if head[start : start + 2] == b"\r\n" else 1
    encoding: Literal["<", ">", "ascii"] | None = None
    elements: list[tuple[str, int, list[tuple[str, str]]]] = []
    for line in head[:end].decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            match words:
                case [] | ["comment" | "obj_info", *_]:
                    pass
                case ["format", name, *_]:
                    encoding = FORMATS[name]
                case ["element", name, count]:
                    if int(count) < 0 or name in [element[0] for element in elements]:
                        raise ValueError
                    elements.append((name, int(count), []))
                case ["property", "list", _, _, name]:
                    elements[-1][2].append((name, "list"))
                case ["property", kind, name]:
                    if name in [known for known, _ in elements[-1][2]]:
                        raise ValueError
                    elements[-1][2].append((name, TYPES[kind]))
                case _:
                    raise ValueError
        except (ValueError, KeyError, IndexError) as error:
            raise InputError(subject, field="header", expected="PLY header lines", found=repr(line[:80])) from error
    if encoding is None:
        raise InputError(subject, field="header", expected=f"a format of {sorted(FORMATS)}", found="no format line")
    return Header(encoding, tuple(Element(name, count, tuple(props)) for name, count, props in elements), start)


def read_element(data: bytes, header: Header, name: str, subject: object) -> dict[str, np.ndarray] | np.ndarray:
    """Return the rows of a binary element as a structured array, or of an ASCII element as columns by name.

    Raises:
        InputError: The element is missing, follows one of unknown length, or the data end before its last row.
    """
    before, wanted = _split(header, name, subject)
    if header.encoding == "ascii":
        return _read_ascii(data, header, before, wanted, subject)
    start = header.data_start + sum(element.count * _row_type(header, element).itemsize for element in before)
    row = _row_type(header, wanted)
    available = max(0, len(data) - start) // row.itemsize if row.itemsize else 0
    if available < wanted.count:
        raise InputError(
            subject, field=name, expected=f"{wanted.count} rows of {row.itemsize} bytes", found=f"{available} rows"
        )
    return array_at(data, row, wanted.count, start)


def _split(header: Header, name: str, subject: object) -> tuple[list[Element], Element]:
    before: list[Element] = []
    for element in header.elements:
        lists = [prop for prop, kind in element.properties if kind == "list"]
        if lists:
            raise InputError(
                subject, field=element.name, expected="scalar properties up to the vertices", found=f"list {lists[0]}"
            )
        if element.name == name:
            return before, element
        before.append(element)
    names = [element.name for element in header.elements]
    raise InputError(subject, field="header", expected=f"an element {name!r}", found=names or "no element")


def _row_type(header: Header, element: Element) -> np.dtype[np.void]:
    return np.dtype([(name, header.encoding + kind) for name, kind in element.properties])


def _read_ascii(
    data: bytes, header: Header, before: list[Element], wanted: Element, subject: object
) -> dict[str, np.ndarray]:
    words = data[header.data_start :].split()
    skipped = sum(element.count * len(element.properties) for element in before)
    words = words[skipped : skipped + wanted.count * len(wanted.properties)]
    if len(words) < wanted.count * len(wanted.properties):
        rows = len(words) // max(1, len(wanted.properties))
        raise InputError(subject, field=wanted.name, expected=f"{wanted.count} rows", found=f"{rows} rows")
    try:
        table = np.array(words, dtype="S32").astype(np.float64).reshape(wanted.count, len(wanted.properties))
    except ValueError as error:
        raise InputError(subject, field=wanted.name, expected="numbers", found=error) from error
    return {name: table[:, i] for i, name in enumerate(wanted.names)}
