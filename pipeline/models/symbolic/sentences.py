"""Putting an answer into words: names with articles, lists, places, hedges."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.models.symbolic.knowledge import BUILDING, GROUND, UPRIGHT
from pipeline.models.symbolic.pairs import NEXT_TO_M
from pipeline.models.symbolic.phrases import Phrase
from pipeline.models.symbolic.relations import gaps_m, next_to
from pipeline.models.symbolic.view import View
from pipeline.models.symbolic.words import singular

SPOKEN = {"left": "to the left of", "right": "to the right of", "nearest": "nearest to", "farthest": "farthest from"}
"""How relations are said where their name is not how one says it."""

PARTLY_HIDDEN = 0.15
"""Share of a thing's outline that another must cover for one to say that it is behind it."""
ALWAYS_PLURAL = frozenset({"stairs", "blinds", "clothes", "headphones"})


def hedged(sentence: str, sure: bool) -> str:
    """Return a sentence as it is, or with a doubt before it."""
    if sure:
        return sentence
    lowered = sentence[0].lower() + sentence[1:] if not sentence.startswith("I ") else sentence
    return f"It looks like {lowered}"


def with_article(name: str) -> str:
    """Return "a chair", "an oven", "stairs"."""
    if name in ALWAYS_PLURAL:
        return name
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def listed(names: Sequence[str]) -> str:
    """Return "a lamp, a book and two cups" for names with repeats."""
    counts: dict[str, int] = {}
    for name in names:
        counts[name] = counts.get(name, 0) + 1
    said = [with_article(name) if n == 1 else f"{n} {plural(name)}" for name, n in counts.items()]
    return said[0] if len(said) == 1 else f"{', '.join(said[:-1])} and {said[-1]}"


def plural(name: str) -> str:
    """Return the plural of a category name."""
    if name in ALWAYS_PLURAL or singular(name) != name:
        return name
    if name.endswith("shelf"):
        return name[:-1] + "ves"
    if name == "mouse":
        return "mice"
    if name.endswith(("s", "x", "ch", "sh")):
        return name + "es"
    if name.endswith("y") and name[-2] not in "aeiou":
        return name[:-1] + "ies"
    return name + "s"


def be(phrase: Phrase) -> str:
    """Return "is" or "are" for a noun."""
    return "are" if phrase.plural else "is"


def link_words(phrase: Phrase) -> str:
    """Return what a phrase says of the place, such as "on the table next to the bed"; empty when it says nothing."""
    said_links = []
    for link in phrase.links:
        relation = SPOKEN.get(link.relation, link.relation)
        ends = [link.anchor] + ([link.other] if link.other else [])
        things = " and ".join(f"the {end.words or 'thing'}{spaced(link_words(end))}" for end in ends)
        said_links.append(f"{relation} {things}")
    return " and ".join(said_links)


def place_of(view: View, index: int, *, without: frozenset[str] = frozenset()) -> tuple[str, bool] | None:
    """Return where a thing is ("on the table") and whether that is sure, or None where nothing near it is seen.

    What holds it says most, then what covers or hides it, then what stands next to it; the floor says least.

    Args:
        view: The view.
        index: The thing.
        without: Names not to be used, such as its own.
    """
    thing = view.things[index]
    others = [i for i, other in enumerate(view.things) if i != index and other.name not in without]
    furniture = [i for i in others if view.things[i].kind not in BUILDING]
    standing = view.pairs.standing
    on = standing.on[index]
    for table, words in ((standing.inside, "in"), (standing.on, "on"), (standing.under, "under")):
        # What is below a window is next to it.
        holders = [
            i
            for i in furniture
            if table[index][i]
            and view.things[i].name != thing.name
            and (words == "in" or view.things[i].kind not in UPRIGHT)
        ]
        if holders:
            size = -1.0 if words == "under" else 1.0
            best = min(holders, key=lambda i: (-view.contacts.get((index, i), 0.0), size * view.things[i].share, i))
            return f"{words} the {view.things[best].name}", view.things[best].clear
    beside = _beside(view, index, furniture)
    hanging = [i for i in others if on[i] and view.things[i].kind in UPRIGHT]
    if hanging:
        over = [i for i in furniture if standing.above[index][i]]
        place = f"on the {view.things[hanging[0]].name}"
        if over:
            largest = min(over, key=lambda i: (-view.things[i].share, i))
            return f"{place} above the {view.things[largest].name}", view.things[largest].clear
        return (f"{place} {beside[0]}", beside[1]) if beside else (place, True)
    behind = standing.behind[index]
    hiding = [i for i in furniture if behind[i] and view.covers.get((i, index), 0.0) >= PARTLY_HIDDEN]
    if hiding:
        nearest = min(hiding, key=lambda i: (gaps_m(view, index)[i], i))
        return f"behind the {view.things[nearest].name}", view.things[nearest].clear
    if beside:
        return beside
    ground = [i for i in others if on[i] and view.things[i].kind in GROUND]
    return (f"on the {view.things[ground[0]].name}", False) if ground else None


def _beside(view: View, index: int, furniture: Sequence[int]) -> tuple[str, bool] | None:
    """The nearest neighbour, furniture that everybody sees before small things."""
    thing, gaps, beside = view.things[index], gaps_m(view, index), view.pairs.standing.beside[index]
    close = [i for i in furniture if beside[i] and gaps[i] < 2 * NEXT_TO_M and view.things[i].name != thing.name]
    degrees = [(i, degree) for i in close if (degree := next_to(view, index, i)) > 0.5]
    if not degrees:
        return None
    best, degree = max(degrees, key=lambda pair: (round(pair[1], 2), view.things[pair[0]].share, -pair[0]))
    return f"next to the {view.things[best].name}", degree >= 1.0 and view.things[best].clear


def spaced(text: str) -> str:
    """Return a text with a space before it, or nothing for no text."""
    return f" {text}" if text else ""


def named(phrase: Phrase) -> str:
    """Return the noun with the colour the question gave it: "blue couch"."""
    return " ".join((*phrase.colors[:1], phrase.words or "thing"))


def described(phrase: Phrase) -> str:
    """Return a phrase in words: "a blue chair next to the bed"."""
    if phrase.anything and not phrase.colors:
        return f"anything{spaced(link_words(phrase))}"
    noun = named(phrase)
    return f"{noun if phrase.plural else with_article(noun)}{spaced(link_words(phrase))}"
