"""A visitor of the viewer without a browser: speaks its protocol over a websocket."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

PATIENCE_S = 30.0
"""Longest wait for what should come, on a machine that does other things too."""
HEADER = 16
"""Bytes before the messages: their size as they are, and compressed."""


@dataclass(slots=True)
class Visitor:
    """One connection and all that came over it."""

    socket: Any
    """The connection."""
    messages: list[dict[str, Any]] = field(default_factory=list)
    """In order; arrays are replaced by their bytes."""

    def until(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the first message that is wanted, also of those that came before."""
        for message in self.messages:
            if wanted(message):
                return message
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            new = _decoded(self.socket.recv(deadline - time.monotonic()))
            self.messages += new
            for message in new:
                if wanted(message):
                    return message
        raise AssertionError("it did not come")

    def send(self, kind: str, **fields: Any) -> None:
        """Send a message."""
        import msgspec

        self.socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def set(self, control: dict[str, Any], value: Any) -> None:
        """Set a control, given the message that made it."""
        self.messages.clear()
        self.send("GuiUpdateMessage", uuid=control["uuid"], updates={"value": value})

    def control(self, label: str) -> dict[str, Any]:
        """Return the message that made a control."""
        return self.until(lambda message: message.get("props", {}).get("label") == label)

    def stand(self) -> None:
        """Tell where the camera is, as a browser does when it is ready."""
        self.send(
            "ViewerCameraMessage",
            **{"wxyz": (1.0, 0, 0, 0), "position": (0.0, 0, 0), "fov": 1.0, "near": 0.01, "far": 100.0},
            **{"image_height": 600, "image_width": 800, "look_at": (0.0, 0, 1), "up_direction": (0.0, -1, 0)},
        )


@contextmanager
def visit(port: int) -> Any:
    """Yield a visitor who has been sent all that there is."""
    import viser
    from websockets.sync.client import connect

    protocol: Any = f"viser-v{viser.__version__}"
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol], max_size=None) as socket:
        visitor = Visitor(socket)
        visitor.until(lambda message: message["type"] == "ReplayDoneMessage")
        visitor.stand()
        yield visitor


def _decoded(frame: bytes) -> list[dict[str, Any]]:
    import msgspec
    import zstandard

    size = int.from_bytes(frame[8:HEADER], "little")
    inner = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(frame[HEADER : HEADER + size]))
    at, arrays = HEADER + size, []
    for length in inner["binaryBufferLengths"]:
        at += -at % 8
        arrays.append(frame[at : at + length])
        at += length
    return [_filled(message, arrays) for message in inner["messages"]]


def _filled(value: Any, arrays: list[bytes]) -> Any:
    if isinstance(value, dict):
        if "__binary_index" in value:
            return arrays[value["__binary_index"]]
        return {key: _filled(part, arrays) for key, part in value.items()}
    return [_filled(part, arrays) for part in value] if isinstance(value, list) else value
