"""Words as the rules read them: tokens, singular forms, number words."""

from __future__ import annotations

import re
from functools import lru_cache

_TOKEN = re.compile(r"[a-z]+(?:[-'][a-z]+)*|\d+(?:\.\d+)?|[,.;:?!()]")

_IRREGULAR = {
    "men": "man",
    "women": "woman",
    "people": "person",
    "persons": "person",
    "children": "child",
    "mice": "mouse",
    "shelves": "shelf",
    "bookshelves": "bookshelf",
    "knives": "knife",
    "leaves": "leaf",
    "scarves": "scarf",
    "loaves": "loaf",
    "halves": "half",
    "teeth": "tooth",
    "feet": "foot",
    "couches": "couch",
    "stories": "story",
    "movies": "movie",
    "cookies": "cookie",
    "boxes": "box",
    "tvs": "tv",
    "pcs": "pc",
}
_SAME = frozenset(
    {"clothes", "this", "is", "has", "was", "does", "its", "glass", "gas", "us", "always", "plus", "besides"}
)


def listed_in(text: str) -> tuple[str, ...]:
    """Return the entries of a list written with commas, which reads better than quotes around each."""
    return tuple(" ".join(entry.split()) for entry in text.split(",") if entry.strip())


NUMBERS = {
    word: value
    for value, word in enumerate(
        listed_in(
            "zero, one, two, three, four, five, six, seven, eight, nine, ten, eleven, twelve, thirteen, fourteen, "
            "fifteen, sixteen, seventeen, eighteen, nineteen, twenty"
        )
    )
}
"""Number words."""


@lru_cache(maxsize=8192)
def tokens(text: str) -> tuple[str, ...]:
    """Return the words, numbers and punctuation marks of a text, lower case."""
    return tuple(_TOKEN.findall(text.lower().replace("’", "'").replace("'s ", " is ").replace("colour", "color")))


@lru_cache(maxsize=8192)
def singular(word: str) -> str:
    """Return the singular of a noun; words without a plural ending come back unchanged."""
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    if len(word) < 4 or word in _SAME or not word.endswith("s") or word.endswith(("ss", "us", "is")):
        return word
    if word.endswith("ies"):
        return word[:-3] + "y"
    if word.endswith(("ches", "shes", "sses", "xes", "zes")):
        return word[:-2]
    return word[:-1]


def is_word(token: str) -> bool:
    """Return whether a token is a word or a number and no punctuation mark."""
    return token[0].isalnum()


def number(token: str) -> int | None:
    """Return the whole number a token writes, in digits or as a word."""
    if token.isdigit():
        return int(token)
    return NUMBERS.get(token)


def number_word(count: int) -> str:
    """Return a small number as a word, larger ones in digits."""
    return next((word for word, value in NUMBERS.items() if value == count), str(count))
