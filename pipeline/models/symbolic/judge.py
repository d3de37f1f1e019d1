"""Marking an answer against a reference by the words of both, from 1 (wrong) to 5 (the same)."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.models.symbolic.certainty import Certainty, certainty_of
from pipeline.models.symbolic.content import Content, content_of, opposite_of
from pipeline.models.symbolic.words import tokens

SAME, MORE, PARTLY, LITTLE, WRONG = 5, 4, 3, 2, 1
"""The marks: says the same; the same and more; about half of it; a little of it; something else or nothing."""
HALF = 0.5
"""Share of all words said by either that both must say for a partly right answer."""


def judge(question: str, answer: str, prediction: str, extra_answers: Sequence[str] = ()) -> int:
    """Return the mark of a prediction, 1 to 5: the best over the reference and the other accepted answers.

    Args:
        question: What was asked; its words in a prediction say nothing new.
        answer: The reference.
        prediction: The answer to mark.
        extra_answers: Other accepted answers.
    """
    return max(_mark(question, reference, prediction) for reference in (answer, *extra_answers))


def _mark(question: str, reference: str, prediction: str) -> int:
    if " ".join(reference.lower().split()).rstrip(".") == " ".join(prediction.lower().split()).rstrip("."):
        return SAME
    unknown = certainty_of(prediction) == Certainty.UNKNOWN
    if certainty_of(reference) == Certainty.UNKNOWN:
        return SAME if unknown else WRONG
    if unknown:
        return WRONG
    asked, wanted, given = content_of(question), content_of(reference), content_of(prediction)
    if wanted.polarity is not None:
        return _mark_verdict(asked, wanted, given)
    if wanted.numbers:
        return _mark_numbers(asked, wanted, given)
    for kind in ("colors", "states", "relations"):
        values: frozenset[str] = getattr(wanted, kind)
        if values and not wanted.words - values:
            return _mark_sets(values, getattr(given, kind))
    if "or" in tokens(question) and wanted.words and wanted.words <= asked.words:
        # A choice among what the question offers: "the blue couch" is also named by "the couch".
        chosen = given.words & asked.words
        return SAME if chosen and chosen <= wanted.words and given.words <= asked.words else WRONG
    if wanted.states & opposite_of(given.states):
        return WRONG
    return _mark_words(asked, wanted, given)


def _mark_verdict(asked: Content, wanted: Content, given: Content) -> int:
    """Yes and no decide; what is said besides only makes a right verdict complete."""
    verdict = given.polarity
    if verdict is None and given.states & asked.states:
        verdict = True
    if verdict is None and given.states & opposite_of(asked.states):
        verdict = False
    if verdict is None and given.colors and asked.colors:
        verdict = bool(given.colors & asked.colors)
    if verdict is None:
        return WRONG
    if verdict != wanted.polarity:
        return WRONG
    more = wanted.words - asked.words
    return SAME if more <= given.words else MORE


def _mark_numbers(asked: Content, wanted: Content, given: Content) -> int:
    if not given.numbers:
        return WRONG
    return SAME if wanted.numbers <= given.numbers and len(given.numbers) == len(wanted.numbers) else WRONG


def _mark_words(asked: Content, wanted: Content, given: Content) -> int:
    """Compare what both say beyond the question; a place said with another relation is mostly wrong."""
    reference = wanted.words - asked.words or wanted.words
    prediction = given.words - (asked.words - reference)
    mark = _mark_sets(reference, prediction)
    if mark == PARTLY and reference - prediction <= wanted.colors and not given.colors - wanted.colors:
        mark = MORE
    if wanted.relations and given.relations and not wanted.relations & given.relations and mark > LITTLE:
        return LITTLE
    if mark == SAME and given.relations - wanted.relations - asked.relations and wanted.relations:
        return MORE
    return mark


def _mark_sets(wanted: frozenset[str], given: frozenset[str]) -> int:
    if not wanted or not wanted & given:
        return WRONG
    if wanted == given:
        return SAME
    if wanted < given:
        return MORE
    return PARTLY if len(wanted & given) >= HALF * len(wanted | given) else LITTLE
