"""Answering from several views at once: which view to trust, and which views show what is described."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.models.symbolic.about_states import clearly, measure_option
from pipeline.models.symbolic.answer import Answer
from pipeline.models.symbolic.answer_view import answer_view
from pipeline.models.symbolic.certainty import Certainty, certainty_of
from pipeline.models.symbolic.phrases import Query
from pipeline.models.symbolic.resolve import candidates, prominence, resolve, room_of
from pipeline.models.symbolic.sentences import hedged, named, plural
from pipeline.models.symbolic.view import View
from pipeline.models.symbolic.words import number_word, singular

FITS = 0.55
"""Fit from which a view's main thing is taken for one that is described: all that can be judged holds, with at most
one doubt (small, or a colour that light may have changed)."""


def answer_one(query: Query, views: Sequence[View]) -> tuple[int, str]:
    """Return the view to trust and the answer.

    Args:
        query: The question or description, read.
        views: At least one view.
    """
    answers = [answer_view(query, view) for view in views]
    if query.kind == "count":
        return _counted(query, answers)
    best = _best(query, answers)
    if answers[best].certainty == Certainty.UNKNOWN and len(views) > 1:
        if query.kind == "compare" and query.reference is None:
            return _compared(query, views) or (best, answers[best].text)
        if query.kind == "same room":
            return _rooms(query, views) or (best, answers[best].text)
    return best, answers[best].text


def choose_view(query: Query, views: Sequence[View], texts: Sequence[str] = ()) -> int:
    """Return the view that shows best what is asked, as a judge that sees the candidate views does.

    Given texts, the surest of them come first, as in the choice by text; only the views they came from are compared.

    Args:
        query: The question or description, read.
        views: At least one view.
        texts: What was answered from each view; empty where the judge does not read them.
    """
    levels = [certainty_of(text) for text in texts] or [Certainty.UNKNOWN] * len(views)
    surest = [index for index, level in enumerate(levels) if level == max(levels)]
    return surest[answer_one(query, [views[index] for index in surest])[0]]


def answer_many(query: Query, views: Sequence[View]) -> list[bool]:
    """Return for each view whether the most prominent thing of the described name fits the description."""
    return [_main_thing_fits(query, view) for view in views]


def _best(query: Query, answers: Sequence[Answer]) -> int:
    """The surest view; among equally sure ones, the answer most of what is seen supports, at its best view."""
    indices = range(len(answers))
    if query.kind in ("describe", "which") and any(answer.measure is not None for answer in answers):
        return min(indices, key=lambda i: _by_measure(answers[i], i))
    level = max(answer.certainty for answer in answers)
    surest = [i for i in indices if answers[i].certainty == level]
    weight: dict[str, float] = {}
    for i in surest:
        weight[answers[i].content] = weight.get(answers[i].content, 0.0) + answers[i].support
    if query.kind in ("describe", "which", "exists"):
        return max(surest, key=lambda i: (answers[i].support, -i))
    return max(surest, key=lambda i: (round(weight[answers[i].content], 6), answers[i].support, -i))


def _by_measure(answer: Answer, index: int) -> tuple[bool, float, float, int]:
    """Each view singles out its own nearest or largest; over all views the first of these is meant."""
    seen = answer.certainty >= Certainty.HEDGED and answer.measure is not None
    return not seen, answer.measure if answer.measure is not None else 0.0, -answer.support, index


def _counted(query: Query, answers: Sequence[Answer]) -> tuple[int, str]:
    """Return the largest count of one room, or the sum over rooms where the views show several.

    Views of one room overlap, and a view hides things but does not invent them. Views of different rooms cannot show
    the same thing.
    """
    indices = range(len(answers))
    best = max(indices, key=lambda i: (answers[i].count or 0, answers[i].certainty, answers[i].support, -i))
    by_room: dict[str, int] = {}
    for answer in answers:
        if answer.room and answer.count:
            by_room[answer.room] = max(by_room.get(answer.room, 0), answer.count)
    total = sum(by_room.values())
    if len(by_room) < 2 or query.target.room or query.target.links or total <= (answers[best].count or 0):
        return best, answers[best].text
    return best, f"There are {number_word(total)} {plural(singular(query.target.words))}."


def _compared(query: Query, views: Sequence[View]) -> tuple[int, str] | None:
    """Sizes are taken in metres, so things that no view shows together can still be compared."""
    taken = []
    for option in query.options:
        values = [
            (found.measure, i)
            for i, view in enumerate(views)
            if (found := measure_option(query, option, view)) is not None
        ]
        if not values:
            return None
        # A view may hide part of a thing but adds nothing to it: the largest extent is nearest the truth.
        taken.append(max(values, key=lambda pair: (abs(pair[0]), -pair[1])))
    if len(taken) < 2:
        return None
    best = min(range(len(taken)), key=lambda i: (taken[i][0], i))
    rest = min(value for i, (value, _) in enumerate(taken) if i != best)
    return taken[best][1], hedged(f"The {named(query.options[best])}.", clearly(taken[best][0], rest))


def _rooms(query: Query, views: Sequence[View]) -> tuple[int, str] | None:
    """Two things seen in different views are in one room if both views show signs of it."""
    if not query.options:
        return None
    seen = []
    for phrase in (query.target, query.options[0]):
        rooms = [
            (found[0].fit, -i, room)
            for i, view in enumerate(views)
            if (found := resolve(phrase, view)) and (room := room_of(view, found[0].index))
        ]
        if not rooms:
            return None
        _, at, room = max(rooms)
        seen.append((room, -at))
    if seen[0][0] == seen[1][0]:
        return seen[0][1], "Yes, it looks like they are in the same room."
    return seen[0][1], f"No, one is in the {seen[0][0]} and the other in the {seen[1][0]}."


def _main_thing_fits(query: Query, view: View) -> bool:
    named = candidates(query.target, view)
    if not named or query.target.anything:
        return False
    main = max(named, key=lambda i: (prominence(view.things[i]), -i))
    return any(match.index == main and match.fit >= FITS for match in resolve(query.target, view))
