"""Text from strangers as it may stand in a prompt: it cannot leave its line, and it cannot close the tags around it.

Questions, category names, answers and captions come from data files, scenes and other models. A prompt holds each
between tags such as `<question>` and `</question>`; here they lose what could be taken for such a tag, for a line of
their own, or for a separator of a chat template (`<|im_end|>`).
"""

from __future__ import annotations

import re
import unicodedata

_UNUSUAL = re.compile(r"[^ -~]")
_ANGLES = str.maketrans("<>", "‹›")
_JOINERS = "\u200c\u200d"
"""Zero-width characters that words and emoji of several scripts need; other invisible ones only hide text."""


def one_line(text: str) -> str:
    """Return a text as one line of data: for questions, answers and names.

    Every run of white space, line breaks and control characters among it, becomes a space; angle brackets become
    single guillemets; invisible formatting characters go; half a surrogate pair becomes "?".
    """
    return " ".join(_UNUSUAL.sub(_visible, text.translate(_ANGLES)).split())


def several_lines(text: str) -> str:
    """Return a text like `one_line`, its line breaks kept: for a model's own reply, repeated to it."""
    return "\n".join(one_line(line) for line in text.splitlines())


def _visible(found: re.Match[str]) -> str:
    character = found.group()
    category = unicodedata.category(character)
    if category == "Cc":
        return " "
    if category == "Cs":
        return "?"
    return "" if category == "Cf" and character not in _JOINERS else character
