"""First step of reading a question: its words in groups, each a noun, a colour, a relation and so on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from pipeline.models.symbolic.knowledge import ROOM_NAMES
from pipeline.models.symbolic.lexicon import ANYTHING, COLORS, EXTREMES, RELATIONS, SIZES, STATES, Nouns, nouns_of
from pipeline.models.symbolic.words import is_word, listed_in, singular, tokens

Tag = Literal["noun", "any", "room", "color", "size", "extreme", "state", "relation", "pause", "word"]

_ROOM_KEYS = {tuple(name.split()): room for name, room in ROOM_NAMES.items()}
_LONGEST_RELATION = max(len(phrase) for phrase in RELATIONS)
_SWITCHED = frozenset({"turned", "switched", "powered", "left"})
_VERBS = frozenset({"stand", "stands"})
"""Nouns that are verbs where a relation follows: "which chair stands between"."""
_BE = frozenset({"is", "are", "was", "were"})
_ARTICLES = frozenset({"a", "an", "the", "my", "your", "any", "this", "these", "those"})
_NO_NOUN = (
    _ARTICLES
    | _BE
    | frozenset(
        listed_in(
            "middle, center, centre, corner, corners, front, back, side, sides, same, end, ends, other, one, "
            "image, view, scene, top, bottom, way, time, room, house, apartment, home, place, two, three, four, "
            "five, six, only, first, second, third, last, single, round, square, rectangular, state, status, "
            "number, color, total, kind, type, row, moment, day, night, morning, evening, it, that, which, and, "
            "or, of, not, there, i, you, we, most, more, pair, couple"
        )
    )
)
"""Words that name no thing though an article may stand before them."""
_AFTER_STATE_ON = frozenset({"or", "?", ".", ",", ";"})


@dataclass(frozen=True, slots=True)
class Token:
    """A group of words and what it is."""

    tag: Tag
    """What the group is."""
    text: str
    """The words."""
    value: str = ""
    """Normal form: the colour, relation, state, size or room."""
    exact: frozenset[str] = frozenset()
    """Names a noun stands for."""
    kinds: frozenset[str] = frozenset()
    """Names it may stand for."""
    plural: bool = False
    """A noun in the plural."""


@lru_cache(maxsize=4096)
def tag(question: str, vocabulary: tuple[str, ...]) -> tuple[Token, ...]:
    """Return the groups of a question in order; longer groups win over shorter ones.

    Args:
        question: A question or a description.
        vocabulary: Names the nouns are matched to.
    """
    found = _groups(question, nouns_of(vocabulary))
    return tuple(_unnamed(found, at) for at in range(len(found)))


def _groups(question: str, nouns: Nouns) -> list[Token]:
    words = tokens(question)
    single = [singular(word) for word in words]
    found: list[Token] = []
    at = 0
    while at < len(words):
        length, token = _group(words, single, at, nouns)
        found.append(token)
        at += length
    return found


def _group(words: Sequence[str], single: Sequence[str], at: int, nouns: Nouns) -> tuple[int, Token]:
    word = words[at]
    if not is_word(word):
        return 1, Token("pause", word, word)
    if word == "on" and _is_state_on(words, at):
        return 1, Token("state", word, "on")
    noun = nouns.match(single, at)
    if noun is not None and noun[0] == 1 and word in _VERBS and at and at + 1 < len(words) and _relation(words, at + 1):
        return 1, Token("word", word, word)
    relation = _relation(words, at)
    if relation is not None and (noun is None or relation[0] >= noun[0]):
        return relation[0], Token("relation", " ".join(words[at : at + relation[0]]), relation[1])
    room = next((n for n in (2, 1) if tuple(words[at : at + n]) in _ROOM_KEYS), 0)
    if room and (noun is None or room > noun[0] or (room == noun[0] and not noun[1].exact)):
        text = " ".join(words[at : at + room])
        return room, Token("room", text, ROOM_NAMES[text])
    if noun is not None and not (noun[0] == 1 and (word in COLORS or word in ANYTHING)):
        length, meaning = noun
        text = " ".join(words[at : at + length])
        plural = words[at + length - 1] != single[at + length - 1]
        return length, Token("noun", text, " ".join(single[at : at + length]), meaning.exact, meaning.kinds, plural)
    for tag_name, table in (("color", COLORS), ("extreme", EXTREMES), ("size", SIZES), ("state", STATES)):
        if word in table:
            return 1, Token(tag_name, word, table[word])  # type: ignore[arg-type]
    if word in ANYTHING:
        return 1, Token("any", word, word, plural=word.endswith("s") and word != "this")
    return 1, Token("word", word, word)


def _unnamed(found: Sequence[Token], at: int) -> Token:
    """A plain word after an article, with no noun after it, is a noun the vocabulary has no name for."""
    token = found[at]
    if token.tag != "word" or token.text in _NO_NOUN or not token.text.isalpha():
        return token
    after = at + 1
    while after < len(found) and found[after].tag in ("color", "size"):
        after += 1
    follows = found[after] if after < len(found) else None
    if follows is not None and (follows.tag in ("noun", "any", "room") or follows.text in _NO_NOUN - _BE):
        return token
    before = at - 1
    while before >= 0 and found[before].tag in ("color", "size", "extreme"):
        before -= 1
    if before < 0 or found[before].text not in _ARTICLES:
        return token
    name = singular(token.text)
    return Token("noun", token.text, name, plural=name != token.text)


def _relation(words: Sequence[str], at: int) -> tuple[int, str] | None:
    for length in range(min(_LONGEST_RELATION, len(words) - at), 0, -1):
        # "to the left of" may be said with the thing named between: "to the left side of".
        relation = RELATIONS.get(tuple(words[at : at + length]))
        if relation is not None:
            return length, relation
    return None


def _is_state_on(words: Sequence[str], at: int) -> bool:
    """Tell "is the lamp on?" and "turned on" from "on the table"."""
    after = words[at + 1] if at + 1 < len(words) else "?"
    before = words[at - 1] if at else ""
    return before in _SWITCHED or after in _AFTER_STATE_ON
