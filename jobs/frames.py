"""Frames as tables on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


def print_frame(title: str, frame: pd.DataFrame) -> None:
    """Print a frame as a table; numbers are short, missing values empty.

    Args:
        title: Line above it.
        frame: The rows; an index with a name becomes the first columns.
    """
    from rich.console import Console
    from rich.table import Table

    flat = frame.reset_index() if any(name is not None for name in frame.index.names) else frame
    table = Table(title=title, title_justify="left", title_style="bold")
    for column in flat.columns:
        numeric = flat[column].dtype.kind in "iuf"
        table.add_column(str(column).replace("_", " "), justify="right" if numeric else "left", overflow="fold")
    for row in flat.itertuples(index=False):
        table.add_row(*(_cell(value) for value in row))
    Console().print(table)


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    if value is None or value != value:
        return ""
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1 else f"{value:.1f}"
    return str(value)
