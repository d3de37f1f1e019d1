"""The backend without Ray: questions as coroutines of one event loop, CPU steps one at a time in this process.

Model calls of different questions overlap, as far as the window goes; the CPU steps of one question do not.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from typing import Any

from schemas.calls import TimingRow
from schemas.plan import PlannedUnit
from schemas.questions import Question
from workers.contexts import Recent
from workers.steps import Steps, Tables, Work
from workers.thumbnails import save_thumbnails


class InProcess:
    """Runs questions in the calling process.

    Args:
        work: What the run needs.
        steps: The functions of a question.
    """

    def __init__(self, work: Work, steps: Steps) -> None:
        self._work, self._steps = work, steps
        self._loop = asyncio.new_event_loop()
        self._caller = steps.make_caller(work)
        self._scenes: Recent[tuple[Any, Any]] = Recent()
        self._times: dict[str, TimingRow] = {}

    def submit(self, unit: PlannedUnit, question: Question) -> asyncio.Task[Tables]:
        """Start a question."""
        return self._loop.create_task(self._answer(unit, question))

    def wait(self, handles: Sequence[asyncio.Task[Tables]], timeout_s: float) -> Sequence[asyncio.Task[Tables]]:
        """Run the loop until a question has ended or the time is over."""
        pending = asyncio.wait(handles, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        done, _ = self._loop.run_until_complete(pending)
        return [handle for handle in handles if handle in done]

    def result(self, handle: asyncio.Task[Tables]) -> Tables:
        """Return a question's records or raise its error."""
        return handle.result()

    def cancel(self, handle: asyncio.Task[Tables]) -> None:
        """Cancel a question at its next wait."""
        handle.cancel()

    def forget(self, unit: PlannedUnit) -> None:
        """Drop the unit's scene."""
        self._scenes.drop(unit.scene_uri)

    def failed(self, question: Question, error: Exception) -> Tables:
        """Return the records of a failed question."""
        return self._steps.tables(self._steps.failed_rows(question, error))

    def close(self) -> None:
        """End the loop; cancelled questions get to unwind first."""
        left = asyncio.all_tasks(self._loop)
        for task in left:
            task.cancel()
        if left:
            self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
        self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        self._loop.close()

    def _opened(self, unit: PlannedUnit) -> tuple[Any, Any]:
        start = time.perf_counter()
        scene = self._steps.load(unit.scene_uri)
        self._times[unit.scene_uri] = TimingRow("", unit.scene, "load", time.perf_counter() - start, 1)
        return self._steps.open_context(scene), self._steps.vocabulary(scene)

    async def _answer(self, unit: PlannedUnit, question: Question) -> Tables:
        steps, method = self._steps, self._work.method
        context, vocabulary = self._scenes.get(unit.scene_uri, lambda: self._opened(unit))
        evidence = await steps.find_evidence(question, vocabulary, self._caller, method)
        proposal = steps.propose(context, question, evidence, method)
        decision = await steps.decide(question, proposal, self._caller, method)
        rows = steps.conclude(context, question, evidence, proposal, decision, method)
        if self._work.images:
            save_thumbnails(self._work.images, steps.thumbnails(proposal, rows))
        tables = steps.tables(rows)
        loading = self._times.pop(unit.scene_uri, None)
        return tables if loading is None else {**tables, "timings": (loading, *tables.get("timings", ()))}
