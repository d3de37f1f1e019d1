"""A real S3 server (moto) in a process of its own, and a proxy before it that misbehaves when told to."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator

BUCKET = "bucket"
START_S = 60.0


class Server:
    """A moto server; what it holds is lost when it ends, so it is stopped by signals, as a machine that hangs."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(self.port)]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + START_S
        while True:
            with contextlib.suppress(OSError):
                request = urllib.request.Request(f"http://127.0.0.1:{self.port}/{BUCKET}", method="PUT")
                urllib.request.urlopen(request, timeout=5).close()
                return
            assert time.monotonic() < deadline
            time.sleep(0.05)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()


class Proxy:
    """Passes connections on to a server; `fault` sees each request's first line and may spoil it.

    `fault(line)` returns "" to pass the request on, "500" to answer so, "reset" to end the connection before the
    server hears of it, "cut" to pass half of the request on and hang up, "lost" to let the server do it and lose its
    answer, or "slow" to wait a second.
    """

    def __init__(self, port: int) -> None:
        self._target = port
        self.fault: Callable[[str], str] = lambda line: ""
        self.requests: list[str] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        self._listener.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._listener.accept()
                threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with client, contextlib.suppress(OSError):
            request = _request(client)
            if not request:
                return
            line = request.split(b"\r\n", 1)[0].decode()
            self.requests.append(line)
            fault = self.fault(line)
            if fault == "slow":
                time.sleep(1.0)
            if fault == "500":
                client.sendall(b"HTTP/1.1 500 Internal Server Error\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
                return
            if fault == "reset":
                return
            with socket.create_connection(("127.0.0.1", self._target)) as server:
                if fault == "cut":
                    server.sendall(request[: len(request) - max(1, len(request) // 4)])
                    return
                server.sendall(request)
                while data := server.recv(1 << 16):
                    if fault != "lost":
                        client.sendall(data)


def _request(client: socket.socket) -> bytes:
    """Return one whole request, with a header that makes the server hang up after its answer."""
    data = b""
    while b"\r\n\r\n" not in data:
        received = client.recv(1 << 16)
        if not received:
            return b""
        data += received
    head, _, body = data.partition(b"\r\n\r\n")
    names = {n.lower(): v.strip() for n, _, v in (line.partition(b":") for line in head.split(b"\r\n")[1:])}
    if names.get(b"expect") == b"100-continue":
        client.sendall(b"HTTP/1.1 100 Continue\r\n\r\n")
    while len(body) < int(names.get(b"content-length", 0)):
        body += client.recv(1 << 16)
    kept = [line for line in head.split(b"\r\n") if not line.lower().startswith((b"connection:", b"expect:"))]
    return b"\r\n".join([*kept, b"Connection: close"]) + b"\r\n\r\n" + body


def address(port: int, path: str = "run") -> str:
    return f"s3://{BUCKET}/{path}?endpoint_override=127.0.0.1:{port}&scheme=http&region=us-east-1"


def keys() -> dict[str, str]:
    """Environment that the server's clients need: any keys do."""
    return {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_EC2_METADATA_DISABLED": "true"}


@contextlib.contextmanager
def s3() -> Iterator[Proxy]:
    """Give a proxy before a fresh server, with keys in the environment."""
    before = {name: os.environ.get(name) for name in keys()}
    os.environ.update(keys())
    server = Server()
    proxy = Proxy(server.port)
    try:
        yield proxy
    finally:
        proxy.close()
        server.close()
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
