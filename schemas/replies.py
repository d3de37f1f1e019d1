"""Table `replies`: the stored model replies of a cache, exported."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.table import TableSpec


@dataclass(frozen=True, slots=True)
class StoredReplyRow:
    """Table `replies`: one stored reply."""

    key: str
    """SHA-256 of all that was asked, as in table calls."""
    stage: str
    """Which prompt asked first."""
    endpoint: str
    """Endpoint's name in the job that asked first."""
    model: str
    """Model the server says it used."""
    reply: str
    """The reply as it came."""
    prompt_tokens: int
    """Tokens in."""
    completion_tokens: int
    """Tokens out."""


STORED_REPLIES = TableSpec(
    name="replies",
    version=1,
    record=StoredReplyRow,
    key=("key",),
    columns={
        "key": "string",
        "stage": "string",
        "endpoint": "string",
        "model": "string",
        "reply": "string",
        "prompt_tokens": "int64",
        "completion_tokens": "int64",
    },
)
