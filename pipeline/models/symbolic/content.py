"""What an answer says: its words without the empty ones, in one form for each meaning."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from pipeline.models.symbolic.knowledge import ROOM_NAMES
from pipeline.models.symbolic.lexicon import CANONICAL, COLORS, OPPOSITE, RELATIONS, STATES
from pipeline.models.symbolic.words import is_word, listed_in, number, singular, tokens

EMPTY = frozenset(
    listed_in(
        "a, an, the, this, that, these, those, it, its, they, them, there, here, is, are, was, were, be, "
        "been, being, am, do, does, did, done, has, have, had, of, to, with, and, or, as, for, from, at, so, "
        "such, very, just, also, too, my, your, our, their, his, her, i, you, we, he, she, one, ones, can, "
        "could, would, will, shall, may, might, should, must, view, image, picture, photo, see, seen, shows, "
        "show, shown, visible, look, looks, looking, like, seems, seem, appears, appear, appearing, probably, "
        "possibly, perhaps, maybe, likely, located, placed, positioned, situated, sitting, standing, lying, "
        "hanging, colored, color, colors, thing, things, object, objects, item, items, some, any, each, both, "
        "side, area, part, which, who, what, where, use, using, used, room, scene"
    )
)
"""Words that say nothing of their own."""

_SAME_PLACE = {"next to": "near", "in front of": "front", "facing": "front"}
_LONGEST = 4
_YES = frozenset({"yes", "yeah", "yep", "correct", "true", "indeed", "certainly"})
_NO = frozenset(
    {"no", "nope", "not", "isn't", "aren't", "doesn't", "don't", "never", "nothing", "none", "false", "neither"}
)


@dataclass(frozen=True, slots=True)
class Content:
    """What a text says."""

    words: frozenset[str]
    """Content words: canonical names, colours, states, rooms and whatever else is not empty."""
    colors: frozenset[str]
    """Basic colour names among them."""
    numbers: frozenset[int]
    """Whole numbers."""
    relations: frozenset[str]
    """Relations, those that mean nearness as one."""
    states: frozenset[str]
    """States."""
    polarity: bool | None
    """True for yes, False for no, None for neither."""


@lru_cache(maxsize=65536)
def content_of(text: str) -> Content:
    """Return what a text says."""
    words = tokens(text)
    content: set[str] = set()
    colors, numbers, relations, states = set(), set(), set(), set()
    at = 0
    while at < len(words):
        word = words[at]
        if not is_word(word):
            at += 1
            continue
        step, name = _name(words, at)
        phrase, relation = _relation(words, at)
        if phrase and phrase >= step:
            relations.add(_SAME_PLACE.get(relation, relation))
            at += phrase
            continue
        if step:
            content.add(name)
            at += step
            continue
        if word in ("left", "right"):
            # "on the right" names a side, not something one is on.
            relations.discard("on")
            relations.add(word)
            at += 1
            continue
        value = number(word)
        if value is not None and word not in EMPTY:
            numbers.add(value)
        elif word in COLORS:
            colors.add(COLORS[word])
            content.add(COLORS[word])
        elif word in STATES:
            states.add(STATES[word])
            content.add(STATES[word])
        elif word not in EMPTY and word not in _YES and word not in _NO:
            content.add(singular(word))
        elif word == "one" and at + 1 < len(words) and words[at + 1] not in EMPTY:
            numbers.add(1)
        at += 1
    if len(words) and words[-1 if is_word(words[-1]) else -2 if len(words) > 1 else 0] == "on":
        states.add("on")
        content.add("on")
        relations.discard("on")
    return Content(
        frozenset(content),
        frozenset(colors),
        frozenset(numbers),
        frozenset(relations),
        frozenset(states),
        _polarity(words),
    )


def _name(words: tuple[str, ...], at: int) -> tuple[int, str]:
    """Return how many words from here name a room or a thing that has several names, and the one used for it."""
    for length in range(min(_LONGEST, len(words) - at), 0, -1):
        group = words[at : at + length]
        text = " ".join(group)
        if text in ROOM_NAMES:
            after = words[at + length] if at + length < len(words) else ""
            if after.isalpha() and after not in EMPTY and (after,) not in RELATIONS:
                # "bathroom counter" is a counter, not a place in the bathroom.
                return length + 1, f"{text} {singular(after)}"
            return length, ROOM_NAMES[text]
        name = CANONICAL.get(tuple(singular(word) for word in group))
        if name is not None and not (length == 1 and group[0] in COLORS):
            return length, name
    return 0, ""


def _relation(words: tuple[str, ...], at: int) -> tuple[int, str]:
    for length in range(min(5, len(words) - at), 0, -1):
        relation = RELATIONS.get(words[at : at + length])
        if relation is not None:
            return length, relation
    return 0, ""


def _polarity(words: tuple[str, ...]) -> bool | None:
    if words and words[0] in _YES:
        return True
    if words and words[0] in _NO:
        return False
    return False if any(word in _NO for word in words) else None


def opposite_of(states: frozenset[str]) -> frozenset[str]:
    """Return the states that contradict these."""
    return frozenset(OPPOSITE[state] for state in states if state in OPPOSITE)
