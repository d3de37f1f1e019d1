"""Which things serve a purpose that a question names, and what a thing is for."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.models.symbolic.knowledge import USES


def useful_names(words: Sequence[str]) -> tuple[str, ...]:
    """Return names of things that serve what the words speak of, most useful first.

    Args:
        words: Words of a question, lower case.
    """
    hits = [
        (-len(triggers), order, names)
        for order, (triggers, names, _) in enumerate(USES)
        if all(any(word.startswith(trigger) for word in words) for trigger in triggers)
    ]
    return tuple(dict.fromkeys(name for _, _, names in sorted(hits) for name in names))


def purpose_of(name: str) -> str:
    """Return what a thing is used for, or "" where that is not known."""
    ranked = [(names.index(name), order, purpose) for order, (_, names, purpose) in enumerate(USES) if name in names]
    return min(ranked)[2] if ranked else ""
