"""What a task's final model call gave."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.answers import Status


@dataclass(frozen=True, slots=True)
class TaskAnswer:
    """The answer of one arm."""

    status: Status
    """answered or unparsed."""
    reason: str
    """Why it is unparsed; empty when it is answered."""
    text: str
    """Answer text; empty when unparsed."""
    chosen: tuple[int, ...]
    """Images the model named, positions among those it was given."""


def unreadable(arm: str) -> TaskAnswer:
    """Return the answer of an arm whose reply could not be read."""
    return TaskAnswer("unparsed", f"the {arm} answer could not be read", "", ())
