"""Reading a question: which thing is meant, how it stands to others, and what is asked of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

from pipeline.models.symbolic.phrases import NOTHING, Kind, Phrase, Query
from pipeline.models.symbolic.question_kind import kind_of
from pipeline.models.symbolic.reading import AUXILIARY, Draft, Reading, read
from pipeline.models.symbolic.tagging import tag
from pipeline.models.symbolic.uses import useful_names

_LOOKING: frozenset[Kind] = frozenset({"where", "check", "exists", "identify", "unknown"})
"""Kinds of question that, about something the vocabulary has no name for, may be about what serves a purpose."""

_USE_MEASURE: dict[Kind, str] = {"check": "can", "exists": "can", "where": "where"}
"""How such a question wants its answer: yes or no, or with the room."""


@lru_cache(maxsize=4096)
def parse_question(question: str, vocabulary: tuple[str, ...]) -> Query:
    """Return a question as the rules understand it.

    Args:
        question: A question or a descriptive sentence.
        vocabulary: Category names the nouns are matched to.
    """
    groups = tag(question, vocabulary)
    words = tuple(word for group in groups if group.tag != "pause" for word in group.text.split())
    kind, measure = kind_of(words, groups)
    words = tuple(word for group in groups if group.tag not in ("pause", "room") for word in group.text.split())
    reading = read(groups)
    if kind in ("check", "color") and "or" in words and len(set(reading.colors)) > 1:
        kind, measure = "color", "choose"
    target, options, reference = _parts(kind, measure, reading, asked_at=_last_verb([g.text for g in groups]))
    if kind == "state":
        measure = " ".join(dict.fromkeys(reading.states))
    if kind == "room" and target.words and not target.named and useful_names(words):
        # "In which room would a family sit?" speaks of no thing but of what rooms are for.
        return Query("room", NOTHING, measure="use", words=words)
    nameless = not target.named and (bool(target.words) or kind == "where")
    if kind in _LOOKING and nameless and useful_names(words):
        return Query("use", target, measure=_USE_MEASURE.get(kind, ""), words=words)
    return Query(kind, target, options, measure, reference, tuple(reading.colors), words)


def _parts(
    kind: Kind, measure: str, reading: Reading, asked_at: int
) -> tuple[Phrase, tuple[Phrase, ...], Phrase | None]:
    """Return target, options and reference (see `Query`)."""
    things = reading.things
    if reading.states and things and not things[0].state and kind != "state":
        things[0].state = reading.states[0]
    target = things[0].freeze() if things else NOTHING
    options = tuple(option.freeze() for option in reading.options)
    if kind == "room" and reading.named:
        # "In which room is the stove?" reads as a place inside the stove.
        return (target if target.words else replace(reading.named[0].freeze(), links=())), options, None
    if kind == "side":
        return _sides(reading.named, asked_at)
    if kind == "same room" and reading.named:
        first, *others = (thing.freeze() for thing in reading.named)
        links = tuple(link for link in first.links if link.relation != "in")
        return replace(first, links=links), tuple(others), None
    if kind == "compare":
        ends = [end for thing in things for relation, ends in thing.links if relation == measure for end in ends]
        offered = tuple(option.freeze() for option in reading.options if not any(option is end for end in ends))
        return target, offered or options, ends[0].freeze() if ends else None
    return target, options, None


def _sides(named: Sequence[Draft], asked_at: int) -> tuple[Phrase, tuple[Phrase, ...], Phrase | None]:
    """Return what is placed, what is faced, and what it is placed by.

    What is placed is named after the verb that asks: "is the lamp left or right of the bed", "which side of the bed is
    the lamp on", "when you face the bed, is the lamp on its left", "I am at the bed, looking toward the door: is ...".
    """
    placed = next((thing for thing in named if thing.at > asked_at), None)
    if placed is None:
        return NOTHING, (), None
    plain = [replace(t.freeze(), state="", links=()) for t in (placed, *(t for t in named if t is not placed))]
    return plain[0], tuple(plain[2:3]), plain[1] if len(plain) > 1 else None


def _last_verb(groups: Sequence[str]) -> int:
    return max((index for index, text in enumerate(groups) if text in AUXILIARY), default=-1)
