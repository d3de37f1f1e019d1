"""The call cache: every reply that was paid for, one small file each, found again by the hash of what was asked.

A file is written aside, synced and renamed, so a reader sees a whole entry or none, and any number of processes and
runs may share a folder. Two that ask the same thing at once write the same key; the later file replaces the earlier.
Only replies are stored: a failed call leaves nothing.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipeline.models.messages import Reply, Request
from schemas import storage
from schemas.errors import InputError

KEY_VERSION = 1
"""Raised when the meaning of a key changes, so that older entries are no longer found."""


def call_key(identity: Mapping[str, Any], request: Request) -> str:
    """Return the SHA-256 of all that can change a reply.

    Args:
        identity: The client's identity: endpoint, model, parameters.
        request: Messages with their images, and the variables (the symbolic model reads those).

    Raises:
        InputError: The identity or a variable holds a value that is not JSON.
    """
    messages = [
        [m.role, [{"text": p} if isinstance(p, str) else {"image": p.sha256()} for p in m.parts]]
        for m in request.messages
    ]
    content = [KEY_VERSION, dict(identity), request.stage, dict(request.variables), messages]
    try:
        text = json.dumps(content, sort_keys=True, ensure_ascii=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{request.stage} call", field="variables", expected="texts, numbers, lists", found=error
        ) from error
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(slots=True)
class CacheCounts:
    """What this process saw of the cache."""

    hits: int = 0
    """Replies found."""
    misses: int = 0
    """Replies looked for and not found."""
    damaged: int = 0
    """Entries found but unreadable, of another key or with a wrong checksum; treated as absent."""
    stored: int = 0
    """Replies written."""


class CallCache:
    """A folder of stored replies.

    Args:
        folder: Where entries lie, in `ab/abcdef....json`; made on first use.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self.counts = CacheCounts()

    def path(self, key: str) -> Path:
        """Return where the entry of a key lies."""
        return self.folder / key[:2] / f"{key}.json"

    def get(self, key: str) -> Reply | None:
        """Return the stored reply, or None when there is none that can be trusted."""
        try:
            content = self.path(key).read_bytes()
        except FileNotFoundError:
            self.counts.misses += 1
            return None
        reply = _decode(key, content)
        if reply is None:
            self.counts.damaged += 1
        else:
            self.counts.hits += 1
        return reply

    def put(self, key: str, reply: Reply, *, stage: str = "", client: str = "") -> None:
        """Store a reply; on return it survives a crash of the machine.

        Args:
            key: From `call_key`.
            reply: What came back.
            stage: For people who read the file; no part of the key's check.
            client: Likewise, the client's name.

        Raises:
            InputError: The folder cannot be written.
        """
        body = asdict(reply)
        entry = {"key": key, "stage": stage, "client": client, "reply": body, "sha256": _checksum(key, body)}
        content = json.dumps(entry, ensure_ascii=False, indent=1)
        storage.write_bytes_atomic(self.path(key), content.encode("utf-8", "surrogatepass"))
        self.counts.stored += 1


@dataclass(frozen=True, slots=True)
class Entry:
    """A file of the cache."""

    path: Path
    """Where it lies."""
    nbytes: int
    """Its size."""
    key: str
    """Its key, as its name says."""
    stage: str
    """Who asked, as noted for people."""
    client: str
    """Endpoint and model, as noted for people."""
    reply: Reply | None
    """The reply; None where the file cannot be trusted."""


def entries(folder: Path) -> Iterator[Entry]:
    """Yield all entries of a cache's folder, sorted by key.

    Raises:
        InputError: There is no such folder.
    """
    if not folder.is_dir():
        raise InputError(folder, expected="a folder of stored replies", found="nothing there")
    for place in sorted(path for path in folder.glob("??") if path.is_dir()):
        for path in sorted(place.glob(f"{place.name}*.json")):
            content = path.read_bytes()
            reply = _decode(path.stem, content)
            noted = json.loads(content.decode("utf-8", "surrogatepass")) if reply is not None else {}
            stage, client = (str(noted.get(field, "")) for field in ("stage", "client"))
            yield Entry(path, len(content), path.stem, stage, client, reply)


def _checksum(key: str, body: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps([key, body], sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def _decode(key: str, content: bytes) -> Reply | None:
    try:
        entry = json.loads(content.decode("utf-8", "surrogatepass"))
        body = entry["reply"]
        if entry["key"] != key or entry["sha256"] != _checksum(key, body):
            return None
        return Reply(**body)
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
