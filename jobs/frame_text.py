"""Frames as text: aligned columns for people, CSV, JSON and a LaTeX table for other programs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

_LATEX = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_LATEX |= {sign: f"\\{sign}" for sign in "&%$#_{}"}
_LATEX |= {"…": r"\dots{}", "±": r"$\pm$", "–": "--"}


def to_records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows as plain data: numbers that are missing become None, sequences lists."""
    names = [str(name) for name in frame.columns]
    return [
        dict(zip(names, map(_plain, row), strict=True))
        for row in frame.astype(object).itertuples(index=False, name=None)
    ]


def to_text(frame: pd.DataFrame) -> str:
    """Return the rows as lines with aligned columns under their names; a dash stands for nothing."""
    rows = [[_shown(value) for value in record.values()] for record in to_records(frame)]
    table = [[str(name).replace("_", " ") for name in frame.columns], *rows]
    numbers = [all(not isinstance(value, str) for value in frame[name]) for name in frame.columns]
    widths = [max(len(row[place]) for row in table) for place in range(len(frame.columns))]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if number else cell.ljust(width)
            for cell, width, number in zip(row, widths, numbers, strict=True)
        ).rstrip()
        for row in table
    )


def to_json(content: Mapping[str, Any]) -> str:
    """Return plain data as JSON; frames in it become lists of rows."""
    return json.dumps(
        {name: to_records(value) if isinstance(value, pd.DataFrame) else value for name, value in content.items()},
        indent=1,
        ensure_ascii=False,
        allow_nan=False,
    )


def to_csv(frame: pd.DataFrame) -> str:
    """Return the rows as CSV with a header; a missing value is an empty field."""
    return str(frame.to_csv(index=False, lineterminator="\n"))


def to_latex(frame: pd.DataFrame, words: Sequence[str], notes: Sequence[str] = (), digits: int = 1) -> str:
    """Return the rows as a booktabs `tabular`.

    Args:
        frame: The rows.
        words: Columns that hold words, set to the left; the others to the right.
        notes: Comment lines above it.
        digits: After the point, of numbers that are not whole.
    """
    names = [str(name) for name in frame.columns]
    layout = "".join("l" if name in words else "r" for name in names)
    rows = [[_cell(value, digits) for value in row.values()] for row in to_records(frame)]
    lines = [f"% {' '.join(note.split())}" for note in notes]
    lines += [rf"\begin{{tabular}}{{{layout}}}", r"\toprule", " & ".join(_escaped(n.replace("_", " ")) for n in names)]
    lines[-1] += r" \\"
    lines += [r"\midrule", *(" & ".join(row) + r" \\" for row in rows), r"\bottomrule", r"\end{tabular}"]
    return "\n".join(lines) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if pd.isna(value):
        return None
    return value.item() if isinstance(value, np.generic) else value


def _cell(value: Any, digits: int) -> str:
    if value is None:
        return "--"
    return f"{value:.{digits}f}" if isinstance(value, float) else _escaped(str(value))


def _escaped(text: str) -> str:
    return "".join(_LATEX.get(sign, sign) for sign in text)


def _shown(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:,.2f}" if isinstance(value, float) else str(value)
