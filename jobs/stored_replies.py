"""What lies in a folder of stored model replies: counted, checked, exported."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from pipeline.models.cache import CallCache, Entry, entries
from schemas.parts import write_stream
from schemas.replies import STORED_REPLIES, StoredReplyRow

ROWS_AT_ONCE = 10_000
"""Replies held in memory while exporting."""


@dataclass(slots=True)
class Count:
    """Replies of one kind."""

    replies: int = 0
    """Replies."""
    prompt_tokens: int = 0
    """Tokens in."""
    completion_tokens: int = 0
    """Tokens out."""
    nbytes: int = 0
    """Bytes of their files."""


@dataclass(slots=True)
class Contents:
    """What a folder holds."""

    counts: dict[tuple[str, str], Count] = field(default_factory=dict)
    """By client and stage, sorted."""
    damaged: list[Path] = field(default_factory=list)
    """Files that cannot be trusted: they count as absent, and their calls are sent again."""


def contents(folder: Path) -> Contents:
    """Read every entry of a folder, after writing those that a crash left in a log alone.

    Raises:
        InputError: There is no such folder, or what a crash left cannot be written.
    """
    found = Contents()
    for entry in _restored(folder):
        if entry.reply is None:
            found.damaged.append(entry.path)
            continue
        count = found.counts.setdefault((entry.client, entry.stage), Count())
        count.replies += 1
        count.prompt_tokens += entry.reply.prompt_tokens
        count.completion_tokens += entry.reply.completion_tokens
        count.nbytes += entry.nbytes
    found.counts = dict(sorted(found.counts.items()))
    return found


def export(folder: Path, output: Path) -> int:
    """Write the entries that can be trusted as table `replies`, sorted by key; return how many.

    Raises:
        InputError: As `contents`.
    """
    sound = (entry for entry in _restored(folder) if entry.reply is not None)
    return write_stream(STORED_REPLIES, _tables(sound), output)


def _restored(folder: Path) -> Iterator[Entry]:
    if folder.is_dir():
        CallCache(folder).restore()
    return entries(folder)


def _tables(sound: Iterator[Entry]) -> Iterator[Any]:
    """Yield Arrow tables."""
    while rows := [_row(entry) for entry in islice(sound, ROWS_AT_ONCE)]:
        yield STORED_REPLIES.to_arrow(rows)


def _row(entry: Entry) -> StoredReplyRow:
    assert entry.reply is not None
    endpoint, _, model = entry.client.partition(":")
    reply = entry.reply
    return StoredReplyRow(
        entry.key,
        entry.stage,
        endpoint,
        reply.model or model,
        reply.text,
        reply.prompt_tokens,
        reply.completion_tokens,
    )
