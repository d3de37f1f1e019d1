"""What is wrong with a job's data, gathered so that a person sees all of it at once and not one thing a run."""

from __future__ import annotations

from schemas.errors import InputError

SHOWN = 100
"""Problems shown; who has more has one cause for most of them."""


class Problems:
    """Errors met on the way through a job's data."""

    def __init__(self) -> None:
        self._first: list[InputError] = []
        self._count = 0

    def add(self, error: InputError) -> None:
        """Take in an error."""
        self._count += 1
        if self._count <= SHOWN:
            self._first.append(error)

    def refuse(self) -> None:
        """End here if anything was wrong.

        Raises:
            InputError: The first problem; the others are its notes.
        """
        if not self._first:
            return
        first, *others = self._first
        for other in others:
            first.add_note(str(other))
        if self._count > SHOWN:
            first.add_note(f"and {self._count - SHOWN} more")
        raise first
