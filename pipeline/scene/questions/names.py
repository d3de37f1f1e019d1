"""English for category names: articles, plurals, lists, and which words may mean which categories."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache


def names(text: str) -> frozenset[str]:
    """Return the set of names in a text that separates them with commas."""
    return frozenset(name.strip() for name in text.split(","))


STRUCTURE = frozenset({"wall", "floor", "ceiling"})
"""Parts of the building: never a target and never an anchor."""

FIXTURES = names(
    "window, door, doorframe, curtain, shower, blinds, counter, sink, bathtub, toilet, cabinet, radiator, mirror, "
    "fireplace, stairs, switch, outlet, rail, vent, hood, light, shelf, board, whiteboard"
)
"""Things built in or too large to have been left somewhere."""

_PLURAL_ONLY = frozenset({"blinds", "stairs", "clothes", "headphones", "scissors", "curtains", "shoes", "papers"})
_MASS = {
    "toilet paper": "toilet paper rolls",
    "laundry detergent": "laundry detergent bottles",
    "paper": "sheets of paper",
    "luggage": "pieces of luggage",
}
"""Nouns without an article, and how one counts them."""
_IRREGULAR = {"shelf": "shelves", "bookshelf": "bookshelves", "mouse": "mice", "man": "men", "person": "people"}
_COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")

_KINDS: dict[str, frozenset[str]] = {
    "table": frozenset({"desk", "nightstand", "counter"}),
    "desk": frozenset({"table", "dresser"}),
    "chair": frozenset({"armchair", "stool", "seat", "recliner", "bench"}),
    "armchair": frozenset({"chair", "couch", "sofa chair"}),
    "stool": frozenset({"chair", "ottoman"}),
    "ottoman": frozenset({"stool"}),
    "couch": frozenset({"sofa", "armchair", "sofa chair", "bench"}),
    "shelf": frozenset({"bookshelf", "rack"}),
    "bookshelf": frozenset({"shelf", "cabinet"}),
    "cabinet": frozenset({"dresser", "wardrobe", "closet", "nightstand", "bookshelf"}),
    "dresser": frozenset({"cabinet", "wardrobe", "nightstand"}),
    "wardrobe": frozenset({"cabinet", "closet", "dresser"}),
    "nightstand": frozenset({"cabinet", "end table", "dresser"}),
    "counter": frozenset({"table"}),
    "trash can": frozenset({"trashcan", "bin", "trash bin", "recycling bin", "bucket"}),
    "trashcan": frozenset({"trash can", "bin", "recycling bin", "bucket"}),
    "bin": frozenset({"trash can", "trashcan", "bucket", "basket"}),
    "box": frozenset({"crate", "container", "case"}),
    "basket": frozenset({"bin"}),
    "bag": frozenset({"backpack", "purse", "luggage", "suitcase"}),
    "backpack": frozenset({"bag"}),
    "pillow": frozenset({"cushion"}),
    "cushion": frozenset({"pillow"}),
    "tv": frozenset({"monitor", "television"}),
    "monitor": frozenset({"tv"}),
    "picture": frozenset({"poster", "painting", "mirror"}),
    "poster": frozenset({"picture"}),
    "plant": frozenset({"tree", "flower"}),
    "cup": frozenset({"mug", "glass", "bowl"}),
    "mat": frozenset({"rug", "carpet"}),
    "rug": frozenset({"mat", "carpet"}),
    "lamp": frozenset({"light"}),
    "light": frozenset({"lamp"}),
    "clock": frozenset({"watch"}),
    "bottle": frozenset({"vase"}),
    "microwave": frozenset({"toaster oven", "oven"}),
    "oven": frozenset({"stove", "toaster oven", "microwave"}),
    "stove": frozenset({"oven"}),
    "refrigerator": frozenset({"mini fridge", "fridge", "freezer"}),
    "suitcase": frozenset({"luggage", "bag"}),
    "book": frozenset({"paper", "magazine"}),
}
"""For a word, the categories a person may also mean by it; compounds follow from their last word."""


@cache
def may_be_called(category: str, word: str) -> bool:
    """Return whether a person may call something of this category by this word.

    It errs on the side of yes: the generators use it to reject a description that might denote a second object.
    """
    if category == word or category in _KINDS.get(word, ()):
        return True
    head = category.rsplit(" ", 1)[-1]
    return head == word or category.endswith(word) or word.endswith(" " + category)


def is_plural(noun: str) -> bool:
    """Return whether the noun is used in the plural only, such as "stairs"."""
    return noun.rsplit(" ", 1)[-1] in _PLURAL_ONLY


def plural(noun: str) -> str:
    """Return the plural of a category name."""
    head, of, rest = noun.partition(" of ")
    start, space, last = head.rpartition(" ")
    if is_plural(head):
        return noun
    if noun in _MASS:
        return _MASS[noun]
    if last in _IRREGULAR:
        last = _IRREGULAR[last]
    elif last.endswith(("s", "x", "z", "ch", "sh")):
        last += "es"
    elif last.endswith("y") and last[-2:-1] not in "aeiou":
        last = last[:-1] + "ies"
    else:
        last += "s"
    return start + space + last + of + rest


def with_article(noun: str, head: str = "") -> str:
    """Return the noun phrase with "a" or "an", or bare where English wants none.

    Args:
        noun: Phrase such as "red chair".
        head: Category at its end, where the phrase has words before it.
    """
    if is_plural(noun) or (head or noun) in _MASS:
        return noun
    return ("an " if noun[:1] in "aeiou" else "a ") + noun


def be(noun: str) -> str:
    """Return "are" for nouns used in the plural only, else "is"."""
    return "are" if is_plural(noun) else "is"


def join_names(names: Sequence[str], word: str = "and") -> str:
    """Return "a", "a and b" or "a, b and c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {word} {names[-1]}"


def count_word(count: int) -> str:
    """Return a small number in words, larger ones in digits."""
    return _COUNTS[count] if count < len(_COUNTS) else str(count)


def room_word(room: str) -> str:
    """Return a room's name as a person says it: "bedroom_2" is a bedroom."""
    return room.rstrip("0123456789").rstrip(" _-#").replace("_", " ")


def capital(text: str) -> str:
    """Return the text with a capital letter at the start of each sentence."""
    return re.sub(r"(^|[.?!] )([a-z])", lambda match: match[1] + match[2].upper(), text)
