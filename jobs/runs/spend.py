"""What model calls cost: of rows as they arise, and of a whole run from its diary and its journals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from schemas.calls import CallRow

JOURNALS_READ = 64_000_000
"""Bytes of journals that `status` reads, about 400,000 calls: a second. Beyond, only committed units are counted."""

ANSWERED = frozenset({"ok", "unparsed"})
"""Outcomes of a call that has a reply; the others are tries that failed."""


@dataclass(frozen=True, slots=True)
class CallTotals:
    """Model calls, counted."""

    calls: int = 0
    """Calls that have a reply, sent or found."""
    cached: int = 0
    """Those whose reply was stored: nothing was sent."""
    failed_tries: int = 0
    """Tries that ended in an error."""
    tokens: int = 0
    """Tokens of prompts and replies of calls that were sent."""
    usd: float | None = 0.0
    """Price of calls that were sent, US dollars; None where an endpoint has no price."""

    @classmethod
    def of(cls, rows: Iterable[CallRow]) -> CallTotals:
        """Return the totals of rows of table `calls`."""
        calls = cached = failed = tokens = 0
        usd: float | None = 0.0
        for row in rows:
            if row.outcome not in ANSWERED:
                failed += 1
                continue
            calls += 1
            if row.cached:
                cached += 1
                continue
            tokens += row.prompt_tokens + row.completion_tokens
            usd = None if usd is None or row.usd is None else usd + row.usd
        return cls(calls, cached, failed, tokens, usd)

    @classmethod
    def read(cls, event: Mapping[str, Any]) -> CallTotals:
        """Return the totals that `as_event` gave; fields of later versions are passed over."""
        return cls(**{field.name: event[field.name] for field in fields(cls) if field.name in event})

    @property
    def sent(self) -> int:
        """Calls that were sent and answered."""
        return self.calls - self.cached

    def __add__(self, other: CallTotals) -> CallTotals:
        """Return the sum; a price of which a part is unknown is unknown."""
        usd = None if self.usd is None or other.usd is None else self.usd + other.usd
        return CallTotals(
            self.calls + other.calls,
            self.cached + other.cached,
            self.failed_tries + other.failed_tries,
            self.tokens + other.tokens,
            usd,
        )

    def as_event(self) -> dict[str, Any]:
        """Return plain data for the diary."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Paid:
    """What the endpoints of a run were sent in all sessions, as its journals say: lost and broken-off work included."""

    calls: int
    """Calls let through."""
    tokens: int
    """Tokens; the estimate of a call whose end is not known."""
    usd: float
    """US dollars by the endpoints' prices; 0 for one without."""


def paid(folder: str) -> Paid | None:
    """Return what a run's journals say; None where it has none, or so much that reading it takes seconds.

    Args:
        folder: Folder of the run's journals, local.
    """
    from pathlib import Path

    files = sorted(Path(folder).glob("*.jsonl"))
    if not files or sum(path.stat().st_size for path in files) > JOURNALS_READ:
        return None
    from pipeline.models.journal import Journal

    # No session is this one: a call under way counts with its estimate.
    spent = [Journal(path, "").read().spent for path in files]
    return Paid(sum(s.calls for s in spent), sum(s.tokens for s in spent), sum(s.usd for s in spent))
