"""Which of a scene's categories to look at for a question: those it names, and those that serve what it wants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pipeline.models.symbolic.knowledge import ROOM_SIGNS, STRUCTURE
from pipeline.models.symbolic.lexicon import canonical
from pipeline.models.symbolic.parse_question import parse_question
from pipeline.models.symbolic.phrases import Phrase, Query
from pipeline.models.symbolic.tagging import tag
from pipeline.models.symbolic.uses import useful_names

ON_WALLS = ("picture", "poster", "mirror", "clock", "whiteboard", "tv", "calendar", "bulletin board", "sign")
"""Where to look for what is on a wall: walls themselves are everywhere."""


def rank_evidence(question: str, categories: Sequence[str], k: int) -> str:
    """Return up to k of the categories, most useful first, one a line; "none" when no category helps.

    The target goes first, then what it is related to. A description of something the scene has no category for fits
    nothing; a question about it is still looked into where it says to look.

    Args:
        question: A question or a description.
        categories: Names present in the scene.
        k: Most names returned.
    """
    names = tuple(categories)
    query = parse_question(question, names)
    present = frozenset(names)
    ranked = dict.fromkeys(name for name in _ranked(query, question, names) if name in present)
    building = [name for name in ranked if canonical(name) in STRUCTURE]
    useful = [name for name in ranked if name not in building] + building
    return "\n".join(useful[:k]) or "none"


def _ranked(query: Query, question: str, names: tuple[str, ...]) -> Iterator[str]:
    if query.kind == "use":
        yield from _useful(query, names)
    if query.kind == "describe" and query.target.words and not query.target.named:
        return
    for option in query.options:
        yield from _names(option)
    yield from _names(query.target)
    if query.reference is not None:
        yield from _names(query.reference)
    for group in tag(question, names):
        if group.tag == "noun":
            yield from sorted(group.exact) or sorted(group.kinds)
            if group.value == "wall" and query.target.anything:
                yield from ON_WALLS
        elif group.tag == "room":
            yield from (name for name in names if canonical(name) in ROOM_SIGNS.get(group.value, ()))
    if query.kind != "use" and not query.target.named:
        yield from _useful(query, names)


def _useful(query: Query, names: tuple[str, ...]) -> Iterator[str]:
    for wanted in useful_names(query.words):
        yield from (name for name in names if canonical(name) == canonical(wanted))


def _names(phrase: Phrase) -> Iterator[str]:
    """Yield the names of a phrase, then those of what it is related to."""
    yield from sorted(phrase.exact) or sorted(phrase.kinds)
    for link in phrase.links:
        yield from _names(link.anchor)
        if link.other is not None:
            yield from _names(link.other)
