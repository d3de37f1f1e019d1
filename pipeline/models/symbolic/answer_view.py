"""Answering a question from one view: a definite sentence, a hedged one, or that the view does not tell."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.models.symbolic import about_places, about_states, about_things
from pipeline.models.symbolic.answer import UNKNOWN, Answer
from pipeline.models.symbolic.phrases import Kind, Query
from pipeline.models.symbolic.view import View


def answer_view(query: Query, view: View) -> Answer:
    """Return the answer of one view.

    Args:
        query: The question, read.
        view: What is seen.
    """
    # By identity, which costs nothing: a question that is read again soon is the same object.
    for asked, known in view.answers:
        if asked is query:
            return known
    answer = _ANSWERS[query.kind](query, view)
    view.answers.append((query, answer))
    return answer


def _cannot(query: Query, view: View) -> Answer:
    return UNKNOWN


_ANSWERS: dict[Kind, Callable[[Query, View], Answer]] = {
    "count": about_things.count,
    "color": about_things.color,
    "identify": about_things.identify,
    "exists": about_things.exists,
    "which": about_things.which,
    "describe": about_things.describe,
    "check": about_states.check,
    "state": about_states.state,
    "compare": about_states.compare,
    "material": about_states.material,
    "side": about_states.side,
    "where": about_places.where,
    "room": about_places.room,
    "same room": about_places.same_room,
    "use": about_places.use,
    "purpose": about_places.purpose,
    "unknown": _cannot,
}
