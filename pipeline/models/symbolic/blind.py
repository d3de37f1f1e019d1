"""Guessing without a look: one fixed answer for each kind of question, such as homes have it most often.

This is what a language model that knows homes would say at best; the symbolic one knows this table and nothing else.
"""

from __future__ import annotations

from pipeline.models.symbolic.knowledge import ROOM_SIGNS
from pipeline.models.symbolic.lexicon import canonical
from pipeline.models.symbolic.parse_question import parse_question
from pipeline.models.symbolic.phrases import Kind
from pipeline.models.symbolic.uses import purpose_of, useful_names
from pipeline.models.symbolic.words import tokens

GUESSES: dict[Kind, str] = {
    "count": "There are two.",
    "color": "It is white.",
    "where": "On the table in the living room.",
    "identify": "A lamp.",
    "exists": "Yes.",
    "check": "Yes.",
    "state": "It is closed.",
    "room": "The living room.",
    "material": "It is made of wood.",
    "side": "On the left.",
    "same room": "No.",
    "compare": "The table.",
    "which": "The one next to the table.",
    "describe": "It is next to the table.",
    "use": "The table.",
    "purpose": "To put things on.",
    "unknown": "Yes.",
}
"""Guess by kind of question."""


def answer_blind(question: str) -> str:
    """Return a guess at the answer; what the question itself names is used before the table.

    Args:
        question: The question.
    """
    query = parse_question(question, ())
    words = tokens(question)
    if query.kind == "use" and (useful := useful_names(query.words)):
        return f"Yes, the {useful[0]}." if query.measure == "can" else f"The {useful[0]}."
    if query.kind == "purpose" and (known := purpose_of(canonical(query.target.words))):
        return f"It is used for {known}."
    if query.kind == "room":
        named = (room for room, signs in ROOM_SIGNS.items() if canonical(query.target.words) in signs)
        return f"The {next(named, 'living room')}."
    if query.kind in ("state", "compare", "side", "color") and "or" in words[1:-1]:
        return f"The {words[words.index('or') - 1]} one."
    return GUESSES[query.kind]
