"""Words for things, colours, places and states, and how a vocabulary's names are found in a text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from pipeline.models.symbolic.words import listed_in, singular, tokens
from pipeline.scene.color_names import COLOR_NAMES

SYNONYMS: tuple[tuple[str, ...], ...] = (
    ("couch", "sofa", "settee", "loveseat"),
    ("tv", "television", "tv set", "telly"),
    (
        "trash can",
        "trashcan",
        "trash bin",
        "garbage can",
        "garbage bin",
        "bin",
        "wastebasket",
        "waste bin",
        "rubbish bin",
        "dustbin",
    ),
    ("recycling bin", "recycle bin", "recycling"),
    ("nightstand", "night stand", "bedside table", "night table"),
    ("refrigerator", "fridge", "freezer"),
    ("mini fridge", "minifridge", "small fridge"),
    ("bookshelf", "bookcase", "book shelf", "book case"),
    ("shelf", "shelving unit", "shelving", "rack of shelves"),
    ("stove", "cooktop", "cooker", "hob", "stovetop"),
    ("wardrobe", "armoire"),
    ("dresser", "chest of drawers", "drawers", "drawer"),
    ("cup", "mug"),
    ("picture", "painting", "photo", "photograph", "framed picture", "wall art", "artwork"),
    ("potted plant", "plant", "houseplant"),
    ("laptop", "notebook computer", "laptop computer"),
    ("monitor", "computer monitor", "computer screen", "screen"),
    ("computer tower", "computer", "pc", "desktop computer"),
    ("telephone", "phone"),
    ("curtain", "drape"),
    ("blanket", "comforter", "duvet", "bedspread"),
    ("mat", "rug", "carpet", "floor mat", "doormat"),
    ("suitcase", "luggage"),
    ("backpack", "rucksack", "knapsack"),
    ("bathtub", "tub", "bath tub"),
    ("sink", "washbasin", "basin", "wash basin"),
    ("coffee maker", "coffee machine"),
    ("coffee kettle", "kettle", "teapot"),
    ("fan", "ceiling fan"),
    ("power outlet", "outlet", "electric outlet", "socket", "wall socket", "electrical outlet"),
    ("stuffed animal", "teddy bear", "teddy", "plush toy", "plushie"),
    ("sofa chair", "easy chair"),
    ("office chair", "desk chair", "task chair", "swivel chair", "computer chair"),
    ("ottoman", "footstool", "pouf"),
    ("end table", "side table"),
    ("kitchen counter", "countertop", "counter top", "kitchen island", "worktop"),
    ("kitchen cabinet", "cupboard", "kitchen cupboard"),
    ("radiator", "heater"),
    ("bicycle", "bike"),
    ("stairs", "staircase", "stairway", "stair"),
    ("washing machine", "washer", "laundry machine"),
    ("clothes dryer", "dryer"),
    ("range hood", "exhaust hood", "extractor hood"),
    ("laundry hamper", "hamper"),
    ("vacuum cleaner", "vacuum", "hoover"),
    ("person", "man", "woman", "people"),
    ("desk", "writing desk"),
    ("lamp", "table lamp", "floor lamp", "desk lamp", "standing lamp", "bedside lamp"),
    ("bathroom vanity", "vanity"),
    ("whiteboard", "white board"),
    ("file cabinet", "filing cabinet"),
    ("toilet", "wc"),
    ("keyboard", "computer keyboard"),
    ("mouse", "computer mouse"),
    ("tissue box", "box of tissues", "tissues"),
    ("blinds", "blind"),
    ("headphones", "headphone"),
    ("doorframe", "door frame"),
    ("windowsill", "window sill"),
    ("ball", "football", "soccer ball", "basketball"),
)
"""Words that mean the same thing; the first is the canonical one."""

KINDS: dict[str, tuple[str, ...]] = {
    "chair": ("armchair", "office chair", "sofa chair", "folded chair", "stool"),
    "armchair": ("sofa chair",),
    "seat": ("chair", "armchair", "office chair", "sofa chair", "couch", "stool", "bench", "ottoman"),
    "table": ("coffee table", "dining table", "end table", "desk", "nightstand"),
    "coffee table": ("table",),
    "dining table": ("table",),
    "end table": ("nightstand", "table"),
    "nightstand": ("end table",),
    "light": ("lamp", "ceiling light"),
    "lamp": ("light",),
    "cabinet": ("kitchen cabinet", "bathroom cabinet", "file cabinet", "wardrobe"),
    "kitchen cabinet": ("cabinet",),
    "counter": ("kitchen counter", "bathroom counter"),
    "shelf": ("bookshelf", "rack"),
    "bookshelf": ("shelf",),
    "container": ("box", "basket", "bin", "storage bin", "storage container", "trash can", "bucket"),
    "bag": ("backpack", "purse", "paper bag", "suitcase"),
    "bottle": ("water bottle",),
    "screen": ("monitor", "tv", "projector screen"),
    "pillow": ("cushion",),
    "cushion": ("pillow",),
    "oven": ("stove", "toaster oven"),
    "stove": ("oven",),
    "appliance": (
        "refrigerator",
        "oven",
        "stove",
        "microwave",
        "dishwasher",
        "washing machine",
        "toaster",
        "coffee maker",
    ),
    "plant": ("potted plant",),
    "window covering": ("curtain", "blinds"),
    "clock": ("alarm clock",),
    "board": ("whiteboard", "blackboard", "bulletin board"),
    "computer": ("laptop", "computer tower", "monitor"),
    "basket": ("laundry basket",),
    "closet": ("wardrobe",),
    "wardrobe": ("closet",),
    "musical instrument": ("guitar", "piano", "keyboard piano"),
    "toy": ("stuffed animal", "ball"),
}
"""Narrower or neighbouring names that a word may stand for where its own name is absent."""

ANYTHING = frozenset(
    listed_in(
        "object, objects, thing, things, item, items, something, anything, stuff, furniture, piece, pieces, device, "
        "it, one, ones, what, which, everything, nothing"
    )
)
"""Words for a thing that is not named."""

COLORS: dict[str, str] = {name: name for name in COLOR_NAMES} | {
    "grey": "gray",
    "silver": "gray",
    "tan": "brown",
    "beige": "brown",
    "wooden": "brown",
    "cream": "white",
    "golden": "yellow",
    "gold": "yellow",
    "violet": "purple",
    "magenta": "pink",
    "navy": "blue",
    "turquoise": "blue",
    "teal": "green",
    "maroon": "red",
}
"""Colour words and the basic term each comes closest to."""

NEAR_COLORS: frozenset[frozenset[str]] = frozenset(
    frozenset(pair)
    for pair in (
        ("white", "gray"),
        ("gray", "black"),
        ("brown", "orange"),
        ("brown", "red"),
        ("brown", "yellow"),
        ("orange", "red"),
        ("orange", "yellow"),
        ("pink", "red"),
        ("pink", "purple"),
        ("purple", "blue"),
        ("blue", "gray"),
        ("brown", "black"),
    )
)
"""Colour names that light and shade turn into each other."""

RELATIONS: dict[tuple[str, ...], str] = {
    tuple(phrase.split()): relation
    for relation, phrases in {
        "on": "on|on top of|atop|upon|lying on|sitting on|standing on|placed on|hanging on|supported by",
        "in": "in|inside|inside of|within|into",
        "under": "under|underneath|beneath|below",
        "above": "above|over",
        "behind": "behind|in back of|at the back of|on the far side of",
        "in front of": "in front of|before|on the near side of",
        "next to": "next to|beside|besides|by|alongside|adjacent to|at the side of|to the side of|at|against|touching",
        "near": "near|close to|near to|around|nearby",
        "left": "left of|to the left of|on the left of|on the left side of|to the left side of|to left of",
        "right": "right of|to the right of|on the right of|on the right side of|to the right side of|to right of",
        "between": "between|in between|in-between|in between of",
        "nearest": "nearest|nearest to|closest|closest to|closer to|nearer|nearer to|most near",
        "farthest": "farthest from|furthest from|farther from|further from|farthest|furthest|farthest away from|"
        "furthest away from",
        "facing": "facing|across from|opposite|opposite of|opposite to",
    }.items()
    for phrase in phrases.split("|")
}
"""Phrases for how things stand to each other."""

SIZES: dict[str, str] = {
    "large": "large",
    "big": "large",
    "huge": "large",
    "small": "small",
    "little": "small",
    "tiny": "small",
    "tall": "tall",
    "short": "low",
    "low": "low",
    "long": "wide",
    "wide": "wide",
    "narrow": "narrow",
}
"""Size words that stand before a noun."""

EXTREMES: dict[str, str] = {
    "largest": "large",
    "biggest": "large",
    "bigger": "large",
    "larger": "large",
    "smallest": "small",
    "smaller": "small",
    "tallest": "tall",
    "taller": "tall",
    "highest": "high",
    "higher": "high",
    "lowest": "deep",
    "lower": "deep",
    "shortest": "low",
    "shorter": "low",
    "widest": "wide",
    "wider": "wide",
    "longest": "wide",
    "longer": "wide",
    "narrowest": "narrow",
    "leftmost": "leftmost",
    "rightmost": "rightmost",
}
"""Words that single one thing out of several by a measure."""

STATES: dict[str, str] = {
    "open": "open",
    "opened": "open",
    "ajar": "open",
    "closed": "closed",
    "shut": "closed",
    "lit": "on",
    "off": "off",
    "unlit": "off",
    "empty": "empty",
    "clear": "empty",
    "free": "empty",
    "unoccupied": "empty",
    "occupied": "full",
    "full": "full",
    "cluttered": "full",
    "messy": "full",
}
"""State words; "on" is left to the parser, since it is mostly a place."""

OPPOSITE = {"open": "closed", "closed": "open", "on": "off", "off": "on", "empty": "full", "full": "empty"}
"""The other value of a state."""


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a noun may stand for in a vocabulary."""

    exact: frozenset[str]
    """The name itself and its synonyms."""
    kinds: frozenset[str]
    """Narrower or neighbouring names, for where no exact one is found."""

    @property
    def all(self) -> frozenset[str]:
        """Every name."""
        return self.exact | self.kinds


def key_of(name: str) -> tuple[str, ...]:
    """Return a name as singular words, the form in which nouns are compared."""
    return tuple(singular(token) for token in tokens(name))


CANONICAL: dict[tuple[str, ...], str] = {key_of(word): group[0] for group in SYNONYMS for word in group}
"""Canonical name of every word that has one."""


@lru_cache(maxsize=4096)
def canonical(name: str) -> str:
    """Return the name by which knowledge of a thing is looked up: data sets write "trashcan" and "kitchen cabinets"."""
    key = key_of(name)
    return CANONICAL.get(key, " ".join(key))


class Nouns:
    """The nouns of a vocabulary: its names, their plurals, synonyms and broader words.

    Args:
        vocabulary: Category names.
    """

    def __init__(self, vocabulary: Sequence[str]) -> None:
        names = {key_of(name): name for name in vocabulary}
        words = set(names) | set(CANONICAL) | {key_of(word) for word in KINDS}
        groups = {key_of(word): group for group in SYNONYMS for word in group}
        self._meanings: dict[tuple[str, ...], Meaning] = {}
        for word in words:
            group = [key_of(other) for other in groups.get(word, ())]
            exact = {names[key] for key in (word, *group) if key in names}
            kinds = {
                names[key]
                for other in (word, *group)
                for key in map(key_of, KINDS.get(" ".join(other), ()))
                if key in names
            }
            kinds |= {name for key, name in names.items() if key[-len(word) :] == word and len(key) > len(word)}
            self._meanings[word] = Meaning(frozenset(exact), frozenset(kinds - exact))
        self._longest = max((len(word) for word in self._meanings), default=1)

    def match(self, words: Sequence[str], start: int) -> tuple[int, Meaning] | None:
        """Return how many words from `start` are a noun, and what it means; the longest noun wins.

        Args:
            words: Singular tokens.
            start: First word looked at.
        """
        for length in range(min(self._longest, len(words) - start), 0, -1):
            meaning = self._meanings.get(tuple(words[start : start + length]))
            if meaning is not None:
                return length, meaning
        return None


@lru_cache(maxsize=64)
def nouns_of(vocabulary: tuple[str, ...]) -> Nouns:
    """Return the nouns of a vocabulary; kept, since every question of a scene asks for the same."""
    return Nouns(vocabulary)
