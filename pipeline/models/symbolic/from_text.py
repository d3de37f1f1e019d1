"""Answering a question from descriptions alone: what the baselines of captions ask of a language model.

Rules over what `facts.py` reads back. They see no picture: what no description says is not known.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.models.symbolic.facts import Fact, read_facts
from pipeline.models.symbolic.knowledge import MATERIALS
from pipeline.models.symbolic.lexicon import canonical
from pipeline.models.symbolic.parse_question import parse_question
from pipeline.models.symbolic.phrases import Kind, Link, Phrase, Query
from pipeline.models.symbolic.sentences import be, hedged, link_words, listed, plural, spaced, with_article
from pipeline.models.symbolic.uses import purpose_of, useful_names
from pipeline.models.symbolic.words import number_word, singular

CANNOT_TELL = "I cannot tell from the descriptions."
FITS = 0.5
"""Fit from which a described thing is taken for one that is asked for."""
UNSAID = 0.6
"""Fit left when a description does not say what was asked of a thing."""
WRONG = 0.1
"""Fit left when it says something else."""
MOST_LISTED = 3
"""Things named at most in one answer."""


@dataclass(frozen=True, slots=True)
class _Told:
    """What is known, and of which kind the descriptions are."""

    facts: Sequence[Fact]
    each_once: bool
    """Every thing is described once: descriptions are of objects, not of pictures."""

    def fitting(self, phrase: Phrase) -> list[Fact]:
        """Return the things that fit a phrase, best first."""
        named = [f for f in self.facts if phrase.anything or f.name in phrase.exact]
        named = named or [f for f in self.facts if f.name in phrase.kinds]
        fits = [(_fit(fact, phrase), fact) for fact in named]
        return [fact for fit, fact in sorted(fits, key=lambda pair: -pair[0]) if fit >= FITS]


def answer_from_text(question: str, notes: Sequence[str], *, of_objects: bool) -> str:
    """Return an answer, or that the descriptions do not tell.

    Args:
        question: The question.
        notes: Descriptions, one a picture or one an object.
        of_objects: They are of objects.
    """
    facts = read_facts(notes)
    names = {fact.name for fact in facts} | {anchor for fact in facts for _, anchor in fact.places}
    query = parse_question(question, tuple(sorted(names)))
    rule = _RULES.get(query.kind)
    return (rule(query, _Told(facts, of_objects)) if rule is not None else "") or CANNOT_TELL


def _fit(fact: Fact, phrase: Phrase) -> float:
    fit = 1.0
    if phrase.colors:
        fit *= 1.0 if set(phrase.colors) & set(fact.colors) else WRONG if fact.colors else UNSAID
    if phrase.state:
        fit *= 1.0 if phrase.state in fact.states else WRONG if fact.states else UNSAID
    if phrase.room and fact.room:
        fit *= 1.0 if phrase.room == fact.room else WRONG
    for link in phrase.links:
        fit *= 1.0 if _holds(fact, link) else UNSAID
    return fit


def _holds(fact: Fact, link: Link) -> bool:
    names = link.anchor.exact | link.anchor.kinds
    return any(place == link.relation and (link.anchor.anything or name in names) for place, name in fact.places)


def _most(values: Sequence[str]) -> str:
    """The most frequent value, the first of several; empty for none."""
    return Counter(values).most_common(1)[0][0] if values else ""


def _count(query: Query, told: _Told) -> str:
    noun = query.target.words or "thing"
    found = told.fitting(query.target)
    counts = Counter(fact.note for fact in found)
    n = len(found) if told.each_once else max(counts.values(), default=0)
    if not n:
        return f"I do not see any {noun}."
    one = singular(noun)
    return f"There is {number_word(1)} {one}." if n == 1 else f"There are {number_word(n)} {plural(one)}."


def _color(query: Query, told: _Told) -> str:
    seen = _most([fact.colors[0] for fact in told.fitting(query.target) if fact.colors])
    return f"The {query.target.words} {be(query.target)} {seen}." if seen else ""


def _where(query: Query, told: _Told) -> str:
    found = told.fitting(query.target)
    place = _most([f"{place} the {name}" for fact in found for place, name in fact.places[:1]])
    room = _most([fact.room for fact in found if fact.room])
    where = f"{place}{spaced(f'in the {room}' if room else '')}".strip()
    return f"The {query.target.words} {be(query.target)} {where}." if where else ""


def _identify(query: Query, told: _Told) -> str:
    target = query.target
    if not (target.links or target.colors or target.named):
        return ""
    said = [fact for fact in told.fitting(target) if all(_holds(fact, link) for link in target.links)]
    if not target.links:
        said = said[:1]
    names = [name for name, _ in Counter(fact.name for fact in said).most_common(MOST_LISTED)]
    return f"There {'is' if len(names) == 1 else 'are'} {listed(names)}{spaced(link_words(target))}." if names else ""


def _exists(query: Query, told: _Told) -> str:
    found = told.fitting(query.target)
    if query.target.anything:
        found = [fact for fact in found if all(_holds(fact, link) for link in query.target.links)]
    if found:
        name = query.target.words or "thing"
        return f"Yes, there {be(query.target)} {name if query.target.plural else with_article(name)}."
    return f"No, I do not see any {query.target.words or 'such thing'}."


def _check(query: Query, told: _Told) -> str:
    if not told.fitting(Phrase(query.target.words, query.target.exact, query.target.kinds)):
        return ""
    found = told.fitting(query.target)
    colors = {color for fact in found for color in fact.colors}
    holds = bool(found) and (not query.said or bool(set(query.said) & colors))
    return "Yes." if holds else "No."


def _state(query: Query, told: _Told) -> str:
    states = [state for fact in told.fitting(query.target) for state in sorted(fact.states)]
    asked = set(query.measure.split())
    seen = _most([state for state in states if not asked or state in asked])
    return f"The {query.target.words} {be(query.target)} {seen}." if seen else ""


def _room(query: Query, told: _Told) -> str:
    found = told.facts if query.target.anything else told.fitting(query.target)
    room = _most([fact.room for fact in found if fact.room])
    return f"The {query.target.words or 'place'} {be(query.target)} in the {room}." if room else ""


def _which(query: Query, told: _Told) -> str:
    for fact in told.fitting(query.target):
        colors = f"{fact.colors[0]} " if fact.colors else ""
        place = f" {fact.places[0][0]} the {fact.places[0][1]}" if fact.places else ""
        return f"The {colors}{fact.name}{place}."
    return ""


def _use(query: Query, told: _Told) -> str:
    there = {canonical(fact.name): fact for fact in reversed(told.facts)}
    for name in useful_names(query.words):
        if name in there:
            room = there[name].room if query.measure == "where" else ""
            head = "Yes, you" if query.measure == "can" else "You"
            return f"{head} can use the {name}{spaced(f'in the {room}' if room else '')}."
    return "No, I do not see anything for that." if query.measure == "can" else ""


def _purpose(query: Query, told: _Told) -> str:
    known = next((use for name in sorted(query.target.exact) if (use := purpose_of(name))), "")
    return f"The {query.target.words} {be(query.target)} used for {known}." if known else ""


def _material(query: Query, told: _Told) -> str:
    known = next((MATERIALS[f.name] for f in told.fitting(query.target) if f.name in MATERIALS), "")
    return hedged(f"The {query.target.words} {be(query.target)} made of {known}.", False) if known else ""


_RULES: dict[Kind, Callable[[Query, _Told], str]] = {
    "count": _count,
    "color": _color,
    "where": _where,
    "identify": _identify,
    "exists": _exists,
    "check": _check,
    "state": _state,
    "room": _room,
    "which": _which,
    "describe": _which,
    "use": _use,
    "purpose": _purpose,
    "material": _material,
}
"""Rules by what is asked; of other kinds descriptions do not tell."""
