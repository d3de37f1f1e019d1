"""A small server with OpenAI's chat API that answers at once, counts tokens and keeps what it was asked."""

from __future__ import annotations

import asyncio
import hashlib
import json
import threading
from collections import Counter
from collections.abc import Callable
from types import TracebackType
from typing import Any

BYTES_PER_TOKEN = 4
REPLY_TOKENS = 5


def digit(body: dict[str, Any]) -> str:
    """Return "0" or "1", fixed by what is asked."""
    return str(hashlib.sha256(json.dumps(body["messages"]).encode()).digest()[0] % 2)


class CountingServer:
    """Serves from a thread of its own while the context is open.

    Args:
        say: Body to reply text.
        delay_s: Seconds until each reply.
    """

    def __init__(self, say: Callable[[dict[str, Any]], str] = digit, delay_s: float = 0.0) -> None:
        self._say, self._delay_s = say, delay_s
        self.asked: Counter[str] = Counter()
        self.answered: Counter[str] = Counter()
        self.tokens: dict[str, int] = {}
        self.under_way = self.most_under_way = 0
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> CountingServer:
        self._thread.start()
        start = asyncio.start_server(self._serve, "127.0.0.1", 0, backlog=1024)
        self._server = asyncio.run_coroutine_threadsafe(start, self._loop).result()
        self.base_url = f"http://127.0.0.1:{self._server.sockets[0].getsockname()[1]}/v1"
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    @property
    def sent(self) -> int:
        """Requests that came in."""
        return sum(self.asked.values())

    @property
    def sent_tokens(self) -> int:
        """Tokens of all requests that came in, with those of their replies."""
        return sum(self.tokens[name] * count for name, count in self.asked.items())

    async def _end(self) -> None:
        self._server.close()
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                head = await reader.readuntil(b"\r\n\r\n")
                length = next(
                    int(line.partition(b":")[2])
                    for line in head.lower().split(b"\r\n")
                    if line[:15] == b"content-length:"
                )
                name, reply = self._take(await reader.readexactly(length))
                if self._delay_s:
                    await asyncio.sleep(self._delay_s)
                self.under_way -= 1
                await self._reply(name, reply, writer)
                await writer.drain()
                self.answered[name] += 1
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            pass  # the client is gone, or the test over
        finally:
            writer.close()

    async def _reply(self, name: str, reply: bytes, writer: asyncio.StreamWriter) -> None:
        """Write the whole answer to a call."""
        head = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n" % len(reply)
        writer.write(head + reply)

    def _take(self, body: bytes) -> tuple[str, bytes]:
        name = hashlib.sha256(body).hexdigest()
        prompt = len(body) // BYTES_PER_TOKEN
        self.asked[name] += 1
        self.tokens[name] = prompt + REPLY_TOKENS
        self.under_way += 1
        self.most_under_way = max(self.most_under_way, self.under_way)
        asked = json.loads(body)
        reply = {
            "model": asked["model"],
            "choices": [{"index": 0, "finish_reason": "stop", "message": {"content": self._say(asked)}}],
            "usage": {"prompt_tokens": prompt, "completion_tokens": REPLY_TOKENS},
        }
        return name, json.dumps(reply).encode()
