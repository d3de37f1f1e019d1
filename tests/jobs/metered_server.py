"""A server with OpenAI's chat API that replies by the symbolic model's rules and bills by a count of its own.

The rules need what a view shows besides its colours, which no endpoint is sent. So the client works a reply out and
hands it over with the request; the server gives it back over HTTP and counts the tokens of what else came.
"""

from __future__ import annotations

import base64
import json
import re
import struct
from collections.abc import Mapping
from contextvars import ContextVar
from dataclasses import replace
from typing import Any

from pipeline.models.caller import Caller
from pipeline.models.endpoint import EndpointClient
from pipeline.models.estimate import Price
from pipeline.models.messages import Reply, Request
from pipeline.models.symbolic import SymbolicModel
from tests.models.counting_server import CountingServer
from workers.method_steps import METHOD_STEPS, make_caller
from workers.steps import Work

WORD_LETTERS = 9
"""A word of the prompts' English is one token up to here."""
PIECE_LETTERS = 6
"""Letters of each token of a longer one."""
TILE = 512
"""Pictures are billed by squares of this side, as hosted vision models do."""
PICTURE_TOKENS, TILE_TOKENS = 85, 170
MESSAGE_TOKENS = 4
PRICE = Price(2.5, 10.0)

_PIECES = re.compile(r"([^\W\d_]+)|\d{1,3}|[^\w\s]+|_+|\n+")
_REPLY: ContextVar[str] = ContextVar("reply")
FIELD = "metered_reply"
"""Field of the request that holds the reply to give."""


class MeteredServer(CountingServer):
    """Serves while the context is open; `bill` holds the calls, tokens in and tokens out of each stage.

    Args:
        delay_s: Seconds until each reply.
    """

    def __init__(self, delay_s: float = 0.0) -> None:
        super().__init__(delay_s=delay_s)
        self.bill: dict[str, list[int]] = {}

    def __enter__(self) -> MeteredServer:
        super().__enter__()
        return self

    def priced(self) -> dict[str, list[float]]:
        """Return the calls, tokens in, tokens out and US dollars of each stage."""
        return {stage: [*billed, PRICE.of(*billed[1:])] for stage, billed in self.bill.items()}

    def _take(self, body: bytes) -> tuple[str, bytes]:
        name, _ = super()._take(body)
        asked = json.loads(body)
        stage, text = asked[FIELD]
        prompt = sum(MESSAGE_TOKENS + _content_tokens(message["content"]) for message in asked["messages"])
        counted = prompt, max(1, text_tokens(text))
        self.tokens[name] = sum(counted)
        billed = self.bill.setdefault(stage, [0, 0, 0])
        for place, number in enumerate((1, *counted)):
            billed[place] += number
        reply = {
            "model": asked["model"],
            "choices": [{"index": 0, "finish_reason": "stop", "message": {"content": text}}],
            "usage": dict(zip(("prompt_tokens", "completion_tokens"), counted, strict=True)),
        }
        return name, json.dumps(reply).encode()


def metered_endpoint(server: MeteredServer, **changes: Any) -> dict[str, Any]:
    """Return the config of an endpoint at the server, with prices."""
    known = {"kind": "openai", "base_url": server.base_url, "model": "m", "image_tokens": PICTURE_TOKENS + TILE_TOKENS}
    price = {"usd_per_million_prompt": PRICE.prompt, "usd_per_million_completion": PRICE.completion}
    return {**known, **price, **changes}


def metered_caller(work: Work, gates: Mapping[str, Any]) -> Caller:
    """Return a run's caller with metered clients."""
    caller = make_caller(work, gates)
    clients = {name: MeteredClient(name, work.models.endpoints[name]) for name in work.models.remote_endpoints()}
    caller.clients = {
        stage: clients.get(client.name.partition(":")[0], client) for stage, client in caller.clients.items()
    }
    return caller


METERED_STEPS = replace(METHOD_STEPS, make_caller=metered_caller)
"""The method, asking a `MeteredServer`."""


class MeteredClient(EndpointClient):
    """An endpoint client that hands over the symbolic model's reply with each request."""

    async def complete(self, request: Request) -> Reply:
        """Send a request with its reply."""
        _REPLY.set((await SymbolicModel().complete(request)).text)
        return await super().complete(request)

    def _body(self, request: Request) -> dict[str, Any]:
        return super()._body(request) | {FIELD: [request.stage, _REPLY.get()]}


def text_tokens(text: str) -> int:
    """Count words, pieces of long words, groups of digits, signs and line ends."""
    return sum(
        1 if len(word := match[1] or "") <= WORD_LETTERS else -(-len(word) // PIECE_LETTERS)
        for match in _PIECES.finditer(text)
    )


def _content_tokens(content: str | list[dict[str, Any]]) -> int:
    if isinstance(content, str):
        return text_tokens(content)
    return sum(
        text_tokens(part["text"]) if part["type"] == "text" else _picture_tokens(part["image_url"]["url"])
        for part in content
    )


def _picture_tokens(url: str) -> int:
    width, height = struct.unpack(">II", base64.b64decode(url.partition(",")[2][:32])[16:24])  # PNG's header
    return PICTURE_TOKENS + TILE_TOKENS * -(-width // TILE) * -(-height // TILE)
