"""Answers about which things there are: what, how many, whether any, what colour, which one."""

from __future__ import annotations

from dataclasses import replace

from pipeline.models.symbolic.answer import UNKNOWN, Answer
from pipeline.models.symbolic.answering import elsewhere, stated, unseen, verdict
from pipeline.models.symbolic.phrases import Link, Phrase, Query
from pipeline.models.symbolic.relations import gap_m
from pipeline.models.symbolic.resolve import SURE, Match, resolve
from pipeline.models.symbolic.sentences import (
    ALWAYS_PLURAL,
    be,
    described,
    link_words,
    listed,
    place_of,
    plural,
    spaced,
    with_article,
)
from pipeline.models.symbolic.view import View
from pipeline.models.symbolic.words import number, number_word, singular

SEVERAL = frozenset({"on", "in", "under"})
"""Relations that several things may stand in at once; of the others the nearest thing is meant."""
MOST_LISTED = 3
"""Things named at most in one answer: a list of all one sees is no answer."""
FITS = 0.5
"""Fit above which a thing is taken for one that is asked for: at most one doubt."""
AS_GOOD = 0.9
"""Share of the best fit from which another thing fits as well."""


def color(query: Query, view: View) -> Answer:
    """Name the colour of the thing; where a choice is given, only one of the choice."""
    target = replace(query.target, colors=tuple(c for c in query.target.colors if c not in query.said))
    found = resolve(target, view)
    if not found:
        return UNKNOWN
    thing = view.things[found[0].index]
    rivals = {view.things[m.index].color for m in found if m.fit > AS_GOOD * found[0].fit}
    sure = found[0].fit >= SURE and (len(rivals) == 1 or target.plural)
    seen, second = thing.color, thing.second_color
    if query.measure and seen not in query.said:
        if second not in query.said:
            return UNKNOWN
        seen, sure = second, False
    return stated(f"The {target.words or thing.name} {be(target)} {seen}.", sure, view, found[0], seen)


def count(query: Query, view: View) -> Answer:
    """Count the things that fit."""
    found = [m for m in resolve(query.target, view) if m.fit > FITS]
    noun = query.target.words or "things"
    if not found:
        return unseen(query, view, f"I do not see any {noun}.")
    n = len(found)
    one = next((noun for noun in (query.target.words, *query.target.exact) if noun), view.things[found[0].index].name)
    one = one if one in ALWAYS_PLURAL else singular(one)
    words = f"There is {number_word(1)} {one}" if n == 1 else f"There are {number_word(n)} {plural(one)}"
    return replace(stated(f"{words}.", found[0].fit >= SURE, view, found[0], str(n)), count=n)


def identify(query: Query, view: View) -> Answer:
    """Name what is at a place or has a colour."""
    target = query.target
    if not (target.links or target.colors or target.extreme or target.named):
        return UNKNOWN
    # A thing of the anchor's own name is mostly another part of it.
    anchors = frozenset[str]().union(*(link.anchor.exact for link in target.links if target.anything))
    found = [m for m in resolve(target, view) if m.fit > FITS and view.things[m.index].name not in anchors]
    if not found:
        return unseen(query, view, f"I do not see anything{spaced(link_words(target))}.")
    best = [m for m in found if m.fit > AS_GOOD * found[0].fit]
    relation = target.links[0].relation if target.links else ""
    if target.colors or target.extreme or not relation:
        best = best[:1]
    elif relation in SEVERAL:
        best = best[:MOST_LISTED]
    else:
        best = sorted(best, key=lambda m: _anchor_gap(target.links[0], view, m))[:1]
    names = [view.things[m.index].name for m in best]
    sentence = f"There {'is' if len(names) == 1 else 'are'} {listed(names)}{spaced(link_words(target))}."
    sure = best[0].fit >= SURE and all(view.things[m.index].clear for m in best)
    return stated(sentence, sure, view, best[0], " ".join(sorted(names)))


def exists(query: Query, view: View) -> Answer:
    """Say whether there is one, or as many as asked for; a thing not seen may still be there."""
    target = query.target
    found = [m for m in resolve(target, view) if m.fit > FITS]
    wanted = wanted_number(query.words)
    if len(found) < (wanted or 1):
        return elsewhere(query, view, f"No, I do not see {'that many' if wanted else described(target)}.")
    if wanted:
        return verdict("Yes", f"there are {number_word(len(found))} {target.words}", True, view, found[0])
    name = target.words or view.things[found[0].index].name
    noun = name if target.plural and target.words else with_article(name)
    sentence = f"there {be(target) if target.words else 'is'} {noun}{spaced(link_words(target))}"
    return verdict("Yes", sentence, found[0].fit >= SURE, view, found[0])


def which(query: Query, view: View) -> Answer:
    """Single out one of several by its colour and place."""
    found = resolve(query.target, view)
    if not found:
        return UNKNOWN
    thing = view.things[found[0].index]
    place = place_of(view, found[0].index, without=frozenset({thing.name}))
    name = singular(query.target.words) or thing.name
    words = f"The {thing.color} {name}{spaced(place[0] if place else '')}."
    return stated(words, found[0].fit >= SURE, view, found[0], words)


def describe(query: Query, view: View) -> Answer:
    """Say what and where the described thing is."""
    found = resolve(query.target, view)
    if not found:
        return unseen(query, view, f"I do not see {described(query.target)}.")
    thing = view.things[found[0].index]
    place = place_of(view, found[0].index, without=frozenset({thing.name}))
    where = link_words(_seen_links(query.target, view)) or (place[0] if place else "in this view")
    sentence = f"The {thing.color} {query.target.words or thing.name} {be(query.target)} {where}."
    return stated(sentence, found[0].fit >= SURE, view, found[0], sentence)


def wanted_number(words: tuple[str, ...]) -> int | None:
    """Return the least number asked for in "more than two" or "at least two"; None where there is none."""
    for first, second, third in zip(words, words[1:], words[2:], strict=False):
        n = number(third)
        if n is not None and (first, second) in (("more", "than"), ("at", "least")):
            return n + 1 if first == "more" else n
    return None


def _anchor_gap(link: Link, view: View, match: Match) -> tuple[float, int]:
    anchors = [m for m in resolve(link.anchor, view, 1) if m.index != match.index]
    gaps = [gap_m(view, match.index, anchor.index) for anchor in anchors]
    return min(gaps, default=0.0), match.index


def _seen_links(target: Phrase, view: View) -> Phrase:
    """Return the phrase with those links whose anchors are in view: only these were checked."""
    return replace(target, links=tuple(link for link in target.links if resolve(link.anchor, view, 1)))
