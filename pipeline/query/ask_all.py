"""Several model calls under way at once, with results and rows in the order in which they were asked."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Sequence
from typing import Any, TypeVar

from pipeline.models.caller import Asked, rows_of
from schemas.calls import CallRow

T = TypeVar("T")


async def ask_all(asks: Sequence[Coroutine[Any, Any, Asked[T]]], calls: list[CallRow]) -> list[T | None]:
    """Return the value of every ask, None where the reply could not be read.

    All asks are waited for even when one fails, so that no call is left running and none goes unrecorded.

    Args:
        asks: Coroutines of `Caller.ask`.
        calls: Where the rows are appended, in the order of `asks`, those of failed ones included.

    Raises:
        SplatReasonerError: The first error in the order of `asks`.
    """
    results = await asyncio.gather(*asks, return_exceptions=True)
    errors = [result for result in results if isinstance(result, BaseException)]
    for result in results:
        calls.extend(rows_of(result) if isinstance(result, BaseException) else result.rows)
    if errors:
        raise errors[0]
    return [result.value for result in results if not isinstance(result, BaseException)]
