"""The few ways in which the answers of one view are made."""

from __future__ import annotations

from dataclasses import replace

from pipeline.models.symbolic.answer import UNKNOWN, Answer
from pipeline.models.symbolic.certainty import Certainty
from pipeline.models.symbolic.phrases import Query
from pipeline.models.symbolic.resolve import Match, prominence, resolve, room_of
from pipeline.models.symbolic.sentences import hedged
from pipeline.models.symbolic.view import View


def stated(sentence: str, sure: bool, view: View, match: Match, content: str) -> Answer:
    """Return a sentence as a definite or a hedged answer.

    Args:
        sentence: What is said without a doubt.
        sure: Whether there is none.
        view: The view.
        match: The thing it is said of.
        content: What was found.
    """
    return Answer(
        hedged(sentence, sure),
        Certainty.DEFINITE if sure else Certainty.HEDGED,
        match.fit * prominence(view.things[match.index]),
        content,
        measure=match.measure,
        room=room_of(view, match.index),
    )


def verdict(word: str, sentence: str, sure: bool, view: View, match: Match) -> Answer:
    """Return "Yes" or "No" and why, as a definite or a hedged answer."""
    text = f"{word}, {sentence}." if sure else f"{word}, it looks like {sentence}."
    answer = stated(text, True, view, match, word.lower())
    return answer if sure else replace(answer, certainty=Certainty.HEDGED)


def elsewhere(query: Query, view: View, sentence: str) -> Answer:
    """Return `unseen`; where a view shows another room than the one asked about, that none is seen there stands."""
    seen = room_of(view)
    if query.target.room and seen and seen != query.target.room and not query.target.links:
        return Answer(sentence, Certainty.UNSEEN, 0.0, "no", room=seen)
    return unseen(query, view, sentence)


def unseen(query: Query, view: View, sentence: str) -> Answer:
    """Return that a thing is not seen, or that one cannot tell where its surroundings are not in view either."""
    anchors = [end for link in query.target.links for end in (link.anchor, link.other) if end is not None]
    found = [resolve(anchor, view, 1) for anchor in anchors]
    if not all(found) or (query.target.room and room_of(view) != query.target.room):
        return UNKNOWN
    return Answer(sentence, Certainty.UNSEEN, sum((prominence(view.things[m[0].index]) for m in found), 0.0), "no")
