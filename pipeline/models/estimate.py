"""How many tokens a call may use, before it is sent: what rates and caps reckon with until the server has counted."""

from __future__ import annotations

import json
from dataclasses import dataclass

from pipeline.models.messages import Reply, Request
from pipeline.models.reply_schemas import response_format, schema_note

BYTES_PER_TOKEN = 3.0
"""English runs at four to five bytes a token, code and other languages at two to three; usage corrects it upward."""
TOKENS_PER_MESSAGE = 8
"""Roles and separators."""
UNLIMITED_REPLY_TOKENS = 4096
"""Taken for a reply where the endpoint sets no limit."""
MARGIN = 1.05
"""Kept above the largest ratio of counted to reckoned tokens met so far."""


LIKELY_BYTES_PER_TOKEN = 4.0
"""For forecasts, which are to be right on average and not at most."""


def likely_text_tokens(text: str) -> float:
    """Return the tokens a text likely has."""
    return len(text.encode("utf-8", "replace")) / LIKELY_BYTES_PER_TOKEN


def likely_prompt_tokens(request: Request, image_tokens: int) -> float:
    """Return the tokens a prompt likely has.

    Args:
        request: The prompt.
        image_tokens: Tokens of one picture.
    """
    texts = (part for message in request.messages for part in message.parts if isinstance(part, str))
    words = sum(likely_text_tokens(text) for text in texts)
    return words + image_tokens * len(request.images()) + TOKENS_PER_MESSAGE * len(request.messages)


@dataclass(frozen=True, slots=True)
class Price:
    """What tokens cost, US dollars a million."""

    prompt: float = 0.0
    """Of the prompt."""
    completion: float = 0.0
    """Of the reply."""

    def of(self, prompt_tokens: int, completion_tokens: int) -> float:
        """Return the price of a call, US dollars."""
        return (prompt_tokens * self.prompt + completion_tokens * self.completion) * 1e-6


class TokenEstimate:
    """Upper estimates for one endpoint, raised whenever a server counts more than was reckoned.

    Args:
        image_tokens: Tokens of one picture at the size and detail it is sent with.
        reply_tokens: Longest reply; None where the endpoint sets no limit.
        price: What tokens cost.
        structured: The endpoint's way of asking for a reply's form, whose text counts too.
    """

    def __init__(self, image_tokens: int, reply_tokens: int | None, price: Price, structured: str = "none") -> None:
        self._image_tokens, self._price, self._structured = image_tokens, price, structured
        self._reply_tokens = UNLIMITED_REPLY_TOKENS if reply_tokens is None else reply_tokens
        self._scale = 1.0

    def most(self, request: Request) -> tuple[int, float]:
        """Return the most tokens a call may use, prompt and reply, and the most it may cost, US dollars."""
        prompt = int(self._prompt(request) * self._scale)
        return prompt + self._reply_tokens, self._price.of(prompt, self._reply_tokens)

    def learn(self, request: Request, reply: Reply) -> None:
        """Take note of what a server counted."""
        ratio = reply.prompt_tokens / self._prompt(request)
        if ratio > self._scale:
            self._scale = ratio * MARGIN

    def _prompt(self, request: Request) -> float:
        texts = (part for message in request.messages for part in message.parts if isinstance(part, str))
        size = sum(len(text.encode("utf-8", "replace")) for text in texts)
        form = response_format(request, self._structured)
        if form is not None:
            size += len(json.dumps(form)) + len(schema_note(request).encode("utf-8", "replace"))
        images = self._image_tokens * len(request.images())
        return size / BYTES_PER_TOKEN + images + TOKENS_PER_MESSAGE * len(request.messages)
