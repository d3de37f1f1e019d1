"""One admission for each endpoint of a run, with the run's budget, as its journals left them."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from pathlib import Path

from pipeline.models.admission import Admission, Concurrency
from pipeline.models.budget import Budget, BudgetConfig, Spend
from pipeline.models.config import EndpointConfig, ModelConfig
from pipeline.models.journal import Journal
from pipeline.models.rate import RateWindow

LOST_GRACE_S = 30.0
"""Seconds beyond an endpoint's deadline after which a call under way counts as lost."""


def open_admissions(
    models: ModelConfig,
    caps: BudgetConfig,
    folder: Path,
    session: str,
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
        clock: Monotonic seconds, as the admissions' callers will use.
        wall_clock: Seconds since 1970.
    """
    budget = Budget(caps, Spend())
    admissions = {}
    for name in models.remote_endpoints():
        endpoint = models.endpoints[name]
        journal = Journal(folder / f"{_file_name(name)}.jsonl", session, wall_clock)
        admission = _admission(endpoint, budget, journal)
        past, now_s = journal.read(), clock()
        budget.spent.add(past.spent.calls, past.spent.tokens, past.spent.usd)
        for call in past.calls:
            under_way = call.same_session and call.tokens is None
            admission.restore(call.wish, now_s - call.age_s, call.tokens, under_way=under_way)
        admissions[name] = admission
    return admissions


def _admission(endpoint: EndpointConfig, budget: Budget, journal: Journal) -> Admission:
    return Admission(
        RateWindow(endpoint.requests_per_min, endpoint.tokens_per_min),
        Concurrency(endpoint.concurrency),
        budget,
        lost_after_s=endpoint.deadline_s + LOST_GRACE_S,
        record=journal.record,
    )


def _file_name(endpoint: str) -> str:
    """Names are a person's choice: any characters, any length."""
    return hashlib.sha256(endpoint.encode()).hexdigest()[:16]
