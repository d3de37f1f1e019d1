"""The order of a question's arms, and which of them counts."""

from __future__ import annotations

from collections.abc import Collection

from jobs.scoring.scores import ARMS


def place_of(arm: str) -> tuple[int, str]:
    """Return a sort key: arms in the order of the method, then others by name."""
    return (ARMS.index(arm), "") if arm in ARMS else (len(ARMS), arm)


def standing_arm(arms: Collection[str]) -> str:
    """Return the arm whose answer counts: the last in the order of the method; empty for none."""
    return max(arms, key=place_of, default="")
