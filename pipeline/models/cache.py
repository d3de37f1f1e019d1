"""The call cache: every reply that was paid for, one small file each, found again by the hash of what was asked.

A file is written aside and renamed, so a reader sees a whole entry or none, and any number of processes and runs may
share a folder. Two that ask the same thing at once write the same key; the later file replaces the earlier. Only
replies are stored: a failed call leaves nothing.

Files as such survive their process, not a crash of the machine. So replies are also appended to a log of their process,
synced once for all that are stored together, before anyone uses them; files are synced later, some hundred at a time,
and their log goes. A log whose process has ended is gone through before the next process looks for a reply.
"""

from __future__ import annotations

import asyncio
import copy
import errno
import fcntl
import hashlib
import json
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from pipeline.models.claims import Claims
from pipeline.models.file_log import NO_LOCKS, FileLog, alone, settle, sync, write_unsynced
from pipeline.models.messages import Reply, Request
from schemas.errors import InputError, StopError

KEY_VERSION = 1
"""Raised when the meaning of a key changes, so that older entries are no longer found."""
LOGS = "log"
"""Folder of the logs, in the folder of the cache."""
REPLIES_A_LOG = 1024
"""After so many, files and their 256 folders are synced: in a second or so, aside, and after a crash there is little
to go through."""
GATHER_S = 0.003
"""Replies that come within this time are stored together: little beside the time a model takes."""


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


NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO})
"""A disk that takes no more."""


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


@dataclass(frozen=True, slots=True)
class NewReply:
    """A reply to store."""

    key: str
    """From `call_key`."""
    reply: Reply
    """What came back."""
    stage: str = ""
    """For people who read the file; no part of the key's check."""
    client: str = ""
    """Likewise, the client's name."""

    def content(self) -> bytes:
        """Return its file, which is one line."""
        body = {name: getattr(self.reply, name) for name in _REPLY_FIELDS}
        entry = {"key": self.key, "stage": self.stage, "client": self.client, "reply": body}
        entry["sha256"] = _checksum(self.key, body)
        return json.dumps(entry, ensure_ascii=False).encode("utf-8", "surrogatepass")


class CallCache:
    """A folder of stored replies. Threads may share it.

    Args:
        folder: Where entries lie, in `ab/abcdef....json`; made on first use.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self._place = str(folder)
        self.counts = CacheCounts()
        self._lock = threading.Lock()
        self._restored = False
        self._log: FileLog | None = None
        self._background = ThreadPoolExecutor(1, "call-cache")
        self._settling: Future[None] | None = None
        self._claims = Claims(self.folder / LOGS / "claims")

    def path(self, key: str) -> Path:
        """Return where the entry of a key lies."""
        return self.folder / key[:2] / f"{key}.json"

    def get(self, key: str) -> Reply | None:
        """Return the stored reply, or None when there is none that can be trusted.

        Raises:
            InputError: What an ended process left cannot be written.
        """
        if not self._restored:
            self.restore()
        try:
            # Not by `Path`: most calls look twice and find nothing, which is then three times as fast.
            with open(f"{self._place}/{key[:2]}/{key}.json", "rb", buffering=0) as file:
                content = file.read()
        except FileNotFoundError:
            self.counts.misses += 1
            return None
        reply = _decode(key, content)
        if reply is None:
            self.counts.damaged += 1
        else:
            self.counts.hits += 1
        return reply

    def claim(self, key: str) -> bool:
        """Claim the right to pay for a reply; return whether nobody else has, in this run or another.

        Who gets it has to look for the reply once more, and to call `unclaim` once the reply is stored or will not be.

        Raises:
            InputError: The folder cannot be written.
        """
        with self._writing():
            return self._claims.take(key)

    def unclaim(self, key: str) -> None:
        """Give a claim up."""
        self._claims.free(key)

    def put(self, key: str, reply: Reply, *, stage: str = "", client: str = "") -> None:
        """Store one reply; see `put_all`."""
        self.put_all([NewReply(key, reply, stage, client)])

    def put_all(self, new: Sequence[NewReply]) -> None:
        """Store replies; on return they survive a crash of the machine.

        Raises:
            InputError: The folder cannot be written; then none of them is stored.
        """
        lines = {self.path(one.key): one.content() for one in new}
        with self._lock, self._writing():
            written: list[Path] = []
            try:
                # Files come first: what a process had in hand when it was killed is there without its log.
                for path, content in lines.items():
                    write_unsynced(path, content)
                    written.append(path)
                self._commit(lines)
            except OSError:
                self._log = None
                for path in written:
                    path.unlink(missing_ok=True)
                raise
        self.counts.stored += len(new)

    def restore(self) -> None:
        """Go through the logs of processes that have ended: write what the disk lost, sync the rest.

        Raises:
            InputError: The folder cannot be written.
        """
        with self._lock, self._writing():
            logs = self.folder / LOGS
            if not self._restored and any(logs.glob("*.jsonl")):
                with alone(logs):
                    for path in sorted(logs.glob("*.jsonl")):
                        with suppress(FileNotFoundError):  # its process has just synced its files
                            self._take_over(path)
            self._restored = True

    def close(self) -> None:
        """Sync the files of what was stored; the next process has nothing to go through.

        Raises:
            InputError: They cannot be synced; their log stays.
        """
        self._claims.close()
        with self._lock, self._writing():
            log, self._log = self._log, None
            settling, self._settling = self._settling, None
            if settling is not None:
                settling.result()
            if log is not None:
                settle(log)

    def _commit(self, lines: Mapping[Path, bytes]) -> None:
        if self._log is None:
            try:
                self._log = FileLog(self.folder / LOGS)
            except OSError as error:
                if error.errno not in NO_LOCKS:
                    raise
                sync(list(lines))  # a file system without locks: nobody could tell whose log is left
                return
        self._log.append(lines)
        if len(self._log.paths) >= REPLIES_A_LOG and (self._settling is None or self._settling.done()):
            if self._settling is not None:
                self._settling.result()
            self._settling, self._log = self._background.submit(settle, self._log), None

    def _take_over(self, path: Path) -> None:
        with path.open("r+b") as log:
            try:
                fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return  # its process is at work
            paths = []
            for line in log:
                key = _key(line)
                if key is None:
                    continue  # cut short: nobody used that reply
                paths.append(self.path(key))
                if not paths[-1].exists() or _decode(key, paths[-1].read_bytes()) is None:
                    write_unsynced(paths[-1], line.rstrip(b"\n"))
            sync(paths)
            path.unlink()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            found = error.strerror or error
            if error.errno in NO_ROOM:
                # No question's fault: nothing further can be stored, and so nothing may be asked.
                raise StopError(f"{self.folder}: {found}: make room, then resume") from error
            raise InputError(self.folder, expected="a folder that can be written", found=found) from error


class GroupedPuts:
    """Stores the replies of an event loop's callers, those of a moment at once: one thread, one sync.

    Args:
        cache: Where to.
    """

    def __init__(self, cache: CallCache) -> None:
        self._cache = cache
        self._waiting: list[tuple[NewReply, asyncio.Future[None]]] = []
        self._storing: asyncio.Task[None] | None = None

    async def put(self, new: NewReply) -> None:
        """Store a reply; on return it survives a crash of the machine.

        Raises:
            InputError: The folder cannot be written.
        """
        loop = asyncio.get_running_loop()
        stored: asyncio.Future[None] = loop.create_future()
        self._waiting.append((new, stored))
        if self._storing is None or self._storing.done():
            self._storing = loop.create_task(self._store())
        await stored

    async def _store(self) -> None:
        await asyncio.sleep(GATHER_S)
        while self._waiting:
            batch, self._waiting = self._waiting, []
            failure: Exception | None = None
            try:
                await asyncio.to_thread(self._cache.put_all, [new for new, _ in batch])
            except Exception as error:
                failure = error
            for _, stored in batch:
                if stored.done():
                    continue  # its caller was cancelled
                if failure is None:
                    stored.set_result(None)
                else:
                    stored.set_exception(copy.copy(failure))  # each caller notes its own rows on it


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


def _key(line: bytes) -> str | None:
    """Return the key of a log's line, None where it cannot be trusted."""
    try:
        key = json.loads(line.decode("utf-8", "surrogatepass"))["key"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    return key if isinstance(key, str) and _decode(key, line) is not None else None


_REPLY_FIELDS = tuple(field.name for field in fields(Reply))


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
