"""A proxy that passes requests on and spoils some of the replies, in ways a fault-injecting server does not offer."""

from __future__ import annotations

import asyncio
from collections import Counter
from urllib.parse import urlsplit

FAULTS = ("hang up at once", "hang up in the body", "cut JSON", "HTML", "wrong length", "empty")


class ManglingProxy:
    """Spoils the first reply to every third request; for the running event loop.

    Args:
        url: Server behind, such as http://127.0.0.1:8000.
    """

    def __init__(self, url: str) -> None:
        place = urlsplit(url)
        self._host, self._port = place.hostname or "", place.port or 80
        self._count = 0
        self.faults: Counter[str] = Counter()

    async def __aenter__(self) -> ManglingProxy:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.url = f"http://127.0.0.1:{self._server.sockets[0].getsockname()[1]}"
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while True:
                asked = await _message(reader)
                self._count += 1
                fault = FAULTS[self._count // 3 % len(FAULTS)] if self._count % 3 == 0 else ""
                if fault == "hang up at once":
                    self.faults[fault] += 1
                    break
                back, forth = await asyncio.open_connection(self._host, self._port)
                forth.write(asked)
                reply = await _message(back)
                forth.close()
                spoiled = _spoiled(reply, fault) if reply.startswith(b"HTTP/1.1 200") else reply
                self.faults[fault] += spoiled != reply
                writer.write(spoiled)
                await writer.drain()
                if spoiled != reply:
                    break
        except (asyncio.IncompleteReadError, ConnectionError):
            pass  # the client is gone
        finally:
            writer.close()


async def _message(reader: asyncio.StreamReader) -> bytes:
    head = await reader.readuntil(b"\r\n\r\n")
    lengths = [line for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:")]
    body = await reader.readexactly(int(lengths[0].partition(b":")[2])) if lengths else b""
    return head + body


def _spoiled(reply: bytes, fault: str) -> bytes:
    head, _, body = reply.partition(b"\r\n\r\n")
    if fault == "hang up in the body":
        return head + b"\r\n\r\n" + body[: len(body) // 2]
    if fault == "wrong length":
        return head.replace(str(len(body)).encode(), str(len(body) + 40).encode()) + b"\r\n\r\n" + body
    bodies = {"cut JSON": body[: len(body) // 2], "HTML": b"<html><h1>Gateway</h1></html>", "empty": b""}
    if fault not in bodies:
        return reply
    new = bodies[fault]
    return b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: %d\r\n\r\n%b" % (len(new), new)
