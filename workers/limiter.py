"""One limiter a run: the admissions of its endpoints in one actor, and the gates through which callers ask them.

In one process the same admissions live beside the callers. A limiter that dies is started again by Ray and reads its
journals; exchanges that failed meanwhile are told again by the gates.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.models.budget import BudgetConfig
from pipeline.models.gate import Authority, Exchange, Gate, LocalAuthority, News
from pipeline.models.traffic import open_admissions
from schemas.errors import RetryError
from workers.steps import Work


class Limiter:
    """Holds the admissions of a run; async, so that every gate may listen at once.

    Args:
        work: What the run needs.
    """

    def __init__(self, work: Work) -> None:
        self._authorities = local_authorities(work)

    async def exchange(self, endpoint: str, exchange: Exchange) -> News:
        """Pass an exchange on to an endpoint's admission."""
        return await self._authorities[endpoint].exchange(exchange)


class RemoteAuthority:
    """An admission in the limiter's process.

    Args:
        limiter: Handle of the run's `Limiter`.
        endpoint: Whose admission.
    """

    def __init__(self, limiter: Any, endpoint: str) -> None:
        self._limiter, self._endpoint = limiter, endpoint

    async def exchange(self, exchange: Exchange) -> News:
        """Take in what a gate tells and return the news for it.

        Raises:
            RetryError: The limiter is being started again.
            StopError: What calls cost cannot be noted.
        """
        from ray.exceptions import RayError, RayTaskError

        try:
            news: News = await self._limiter.exchange.remote(self._endpoint, exchange)
        except RayTaskError as error:
            raise error.cause from None
        except RayError as error:
            raise RetryError(f"the limiter does not answer: {type(error).__name__}") from None
        return news


def limited_endpoints(work: Work) -> tuple[str, ...]:
    """Return the endpoints of a run whose calls are sent over a network."""
    return () if work.models is None or work.cache == "replay" else work.models.remote_endpoints()


def local_authorities(work: Work) -> dict[str, Authority]:
    """Return the admissions of a run by endpoint, as its journals left them, for use in this process."""
    if not limited_endpoints(work):
        return {}
    cache = None if work.cache == "off" else Path(work.calls)
    found = open_admissions(work.models, work.budget or BudgetConfig(), Path(work.journals), work.session, cache)
    return {name: LocalAuthority(admission) for name, admission in found.items()}


def remote_authorities(work: Work, limiter: Any) -> dict[str, Authority]:
    """Return the same, where they live in a limiter."""
    return {name: RemoteAuthority(limiter, name) for name in limited_endpoints(work)}


def gates(authorities: Mapping[str, Authority], place: str | None = None) -> dict[str, Gate]:
    """Return a gate to each admission, for one event loop.

    Args:
        authorities: By endpoint.
        place: See `Gate`.
    """
    return {name: Gate(authority, place) for name, authority in authorities.items()}
