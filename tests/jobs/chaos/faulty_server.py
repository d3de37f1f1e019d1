"""A counting server that spoils what it sends: each fault is a function of the request's number."""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tests.models.counting_server import CountingServer


@dataclass(frozen=True, slots=True)
class Spoiled:
    """What is sent in place of an answer."""

    status: int = 200
    headers: tuple[str, ...] = ()
    body: bytes = b'{"error": {"message": "no"}}'
    hang_s: float = 0.0
    """Nothing is sent for so long; then the connection ends."""
    cut: bool = False
    """The connection ends in the middle of the body."""


@dataclass(frozen=True, slots=True)
class Call:
    """A request that waits for its answer."""

    number: int
    """Counted from 1."""
    reply: bytes
    """The proper answer."""
    again: bool
    """Whether it tells the model that its first reply could not be read."""


Fault = Callable[[Call], Spoiled | None]
"""From a call to what is sent instead of its answer; None: the answer."""

FIRST = 2
"""Messages of a request: instructions and question."""


def digit_of_question(body: dict[str, Any]) -> str:
    """Return "0" or "1", fixed by what was asked first: asked again, the same."""
    return str(hashlib.sha256(json.dumps(body["messages"][:FIRST]).encode()).digest()[0] % 2)


class FaultyServer(CountingServer):
    """Serves while the context is open.

    Args:
        fault: What befalls each request; may be put in place later.
        delay_s: Seconds until each reply.
    """

    def __init__(self, fault: Fault | None = None, delay_s: float = 0.0) -> None:
        super().__init__(digit_of_question, delay_s)
        self.fault = fault
        self.number = 0
        self._again: set[str] = set()
        self.spoiled: Counter[str] = Counter()
        """By call, how often it was not answered properly."""

    @property
    def sent_twice(self) -> int:
        """Calls that were asked again although they had been answered."""
        return sum(max(0, count - self.spoiled[name] - 1) for name, count in self.asked.items())

    def _take(self, body: bytes) -> tuple[str, bytes]:
        name, reply = super()._take(body)
        if len(json.loads(body)["messages"]) > FIRST:
            self._again.add(name)
        return name, reply

    async def _reply(self, name: str, reply: bytes, writer: asyncio.StreamWriter) -> None:
        self.number += 1
        call = Call(self.number, reply, name in self._again)
        spoiled = self.fault(call) if self.fault is not None else None
        if spoiled is None:
            await super()._reply(name, reply, writer)
            return
        self.spoiled[name] += 1
        if spoiled.hang_s:
            await asyncio.sleep(spoiled.hang_s)
            raise ConnectionError("hung up")
        length = len(spoiled.body) + (40 if spoiled.cut else 0)
        lines = [f"HTTP/1.1 {spoiled.status} Spoiled", "Content-Type: application/json", f"Content-Length: {length}"]
        writer.write("\r\n".join([*lines, *spoiled.headers, "", ""]).encode() + spoiled.body)
        if spoiled.cut:
            await writer.drain()
            raise ConnectionError("hung up")
