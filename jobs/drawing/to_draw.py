"""What is drawn of a question; apart from the drawing, whose kernels take a while to load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class ToDraw:
    """What is drawn of a question: rows of its tables as plain data."""

    question_id: str
    """Question."""
    clusters: Sequence[Mapping[str, Any]]
    """Rows of `clusters`."""
    candidates: Sequence[Mapping[str, Any]]
    """Rows of `candidates`."""
    regions: Sequence[Mapping[str, Any]]
    """Rows of `regions`, of the arm that counts."""
    targets: tuple[int, ...]
    """Ground-truth instances; empty where unknown."""
