"""How sure an answer is, read off its words: the same for this observer's answers and for any model's."""

from __future__ import annotations

import re
from enum import IntEnum
from functools import lru_cache

CANNOT_TELL = "I cannot tell from this view."
"""Said where a view does not show enough, in the words the prompts suggest."""


class Certainty(IntEnum):
    """Kinds of answer, the more useful ones higher."""

    UNKNOWN = 0
    """Says that it cannot tell."""
    UNSEEN = 1
    """Says that the thing is not seen: less than an answer, since it may be hidden."""
    HEDGED = 2
    """An answer with a doubt."""
    DEFINITE = 3
    """An answer."""


_UNKNOWN = re.compile(
    r"\b(?:can(?:not|'t| not)|could(?: not|n't)|unable to|impossible to|hard to|difficult to|not possible to) "
    r"(?:\w+ ){0,2}?(?:tell|told|say|said|see|seen|determined?|known?|answer|identif\w+|confirm|make out|find|locate)\b"
    r"|\b(?:don't|do not|doesn't|does not) (?:know|show|provide|contain)\b"
    r"|\bnot (?:sure|certain|clear|visible|shown|enough|in (?:this |the )?view|in (?:this |the )?image)\b"
    r"|\b(?:unclear|uncertain|unknown|unsure|no idea|i'm sorry|i am sorry|apologi[sz]e|insufficient|no answer)\b"
)
_UNSEEN = re.compile(
    r"\b(?:do not|don't|did not|didn't) see\b|\bthere (?:is|are) no\b|\bno \w+(?: \w+)? (?:is|are) seen\b|\bsee no\b"
)
_HEDGED = re.compile(
    r"\b(?:looks? like|seems?|appears?|probabl[ye]|possibl[ye]|perhaps|maybe|may be|might|could be|likely|presumably|"
    r"i (?:think|guess|believe)|not entirely|suggests?|approximately|about \d)\b"
)


@lru_cache(maxsize=65536)
def certainty_of(text: str) -> Certainty:
    """Return how sure an answer is; an empty one is unknown."""
    lowered = text.lower().replace("’", "'").strip()
    if not lowered or _UNKNOWN.search(lowered):
        return Certainty.UNKNOWN
    if _UNSEEN.search(lowered):
        return Certainty.UNSEEN
    return Certainty.HEDGED if _HEDGED.search(lowered) else Certainty.DEFINITE
