"""One admission for each endpoint of a run, with the run's budget, as its journals left them."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from pathlib import Path

from pipeline.models.admission import Admission, Concurrency, Done, Wish
from pipeline.models.budget import Budget, BudgetConfig, Spend
from pipeline.models.cache import CallCache
from pipeline.models.config import EndpointConfig, ModelConfig
from pipeline.models.estimate import Price
from pipeline.models.journal import Journal
from pipeline.models.rate import RateWindow

LOST_GRACE_S = 30.0
"""Seconds beyond an endpoint's deadline after which a call under way counts as lost."""


def open_admissions(
    models: ModelConfig,
    caps: BudgetConfig,
    folder: Path,
    session: str,
    calls: Path | None = None,
    *,
    clock: Callable[[], float] = time.monotonic,
    wall_clock: Callable[[], float] = time.time,
) -> dict[str, Admission]:
    """Return the admission of every endpoint that is asked over a network, by the endpoint's name.

    Args:
        models: The endpoints and their limits.
        caps: The run's caps.
        folder: The run's journals.
        session: Name of this session: calls that an admission of the same session let through may be under way.
        calls: Folder of stored replies. A call of an earlier session whose end nobody noted, but whose reply is
            there, used what that says. None where replies are not stored.
        clock: Monotonic seconds, as the admissions' callers will use.
        wall_clock: Seconds since 1970.
    """
    budget = Budget(caps, Spend())
    admissions = {}
    for name in models.remote_endpoints():
        endpoint = models.endpoints[name]
        journal = Journal(folder / f"{_file_name(name)}.jsonl", session, wall_clock)
        answered = _stored_usage(None if calls is None else CallCache(calls), endpoint.price or Price())
        admission = _admission(endpoint, budget, journal, answered)
        for wish in journal.unended():
            done = answered(wish)
            if done is not None:
                journal.record(done)
        past, now_s = journal.read(), clock()
        budget.spent.add(past.spent.calls, past.spent.tokens, past.spent.usd)
        for call in past.calls:
            under_way = call.same_session and call.tokens is None
            admission.restore(call.wish, now_s - call.age_s, call.tokens, under_way=under_way)
        admission.pause(past.pause_s, now_s)
        admissions[name] = admission
    return admissions


def _stored_usage(cache: CallCache | None, price: Price) -> Callable[[Wish], Done | None]:
    """Return what tells the cost of calls that were answered, and stored, by a process killed before it could say."""

    def answered(wish: Wish) -> Done | None:
        reply = cache.get(wish.key) if cache is not None and wish.key else None
        if reply is None:
            return None
        usd = price.of(reply.prompt_tokens, reply.completion_tokens)
        return Done(wish.id, reply.prompt_tokens + reply.completion_tokens or None, usd)

    return answered


def _admission(
    endpoint: EndpointConfig, budget: Budget, journal: Journal, answered: Callable[[Wish], Done | None]
) -> Admission:
    return Admission(
        RateWindow(endpoint.requests_per_min, endpoint.tokens_per_min),
        Concurrency(endpoint.concurrency),
        budget,
        lost_after_s=endpoint.deadline_s + LOST_GRACE_S,
        record=journal.record,
        answered=answered,
    )


def _file_name(endpoint: str) -> str:
    """Names are a person's choice: any characters, any length."""
    return hashlib.sha256(endpoint.encode()).hexdigest()[:16]
