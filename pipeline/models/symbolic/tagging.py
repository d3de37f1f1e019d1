"""First step of reading a question: its words in groups, each a noun, a colour, a relation and so on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pipeline.models.symbolic.knowledge import ROOM_NAMES
from pipeline.models.symbolic.lexicon import ANYTHING, COLORS, EXTREMES, RELATIONS, SIZES, STATES, Nouns
from pipeline.models.symbolic.words import is_word, singular, tokens

Tag = Literal["noun", "any", "room", "color", "size", "extreme", "state", "relation", "pause", "word"]

_ROOM_KEYS = {tuple(name.split()): room for name, room in ROOM_NAMES.items()}
_LONGEST_RELATION = max(len(phrase) for phrase in RELATIONS)
_SWITCHED = frozenset({"turned", "switched", "powered", "left"})
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


def tag(question: str, nouns: Nouns) -> list[Token]:
    """Return the groups of a question in order; longer groups win over shorter ones."""
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
