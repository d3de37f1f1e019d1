"""The backend without Ray: questions as coroutines of one event loop, CPU steps one at a time in this process.

Model calls of different questions overlap, as far as the window goes; the CPU steps of one question do not.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from schemas.calls import TimingRow
from schemas.plan import PlannedUnit
from schemas.questions import Question
from workers.contexts import Recent
from workers.dispatch import Ended
from workers.limiter import gates, local_authorities
from workers.steps import Steps, Tables, Work
from workers.thumbnails import save_thumbnails


@dataclass(slots=True)
class _Opened:
    """What a scene's questions share."""

    context: Any
    vocabulary: Any
    unstored: Any
    times: tuple[TimingRow, ...]
    """Of work done once the scene; empty once a question's records have them."""


class InProcess:
    """Runs questions in the calling process.

    Args:
        work: What the run needs.
        steps: The functions of a question.
        note: Told what happened, as a kind and details: "damaged".
    """

    def __init__(self, work: Work, steps: Steps, note: Callable[..., None] = lambda kind, **details: None) -> None:
        self._work, self._steps, self._note = work, steps, note
        self._loop = asyncio.new_event_loop()
        self._caller = steps.make_caller(work, gates(local_authorities(work)))
        self._scenes: Recent[_Opened] = Recent()

    def submit(self, unit: PlannedUnit, questions: Sequence[Question]) -> asyncio.Task[Ended]:
        """Start questions."""
        return self._loop.create_task(self._answer_all(unit, questions))

    def wait(self, handles: Sequence[asyncio.Task[Ended]], timeout_s: float) -> Sequence[asyncio.Task[Ended]]:
        """Run the loop until a batch has ended or the time is over."""
        pending = asyncio.wait(handles, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        done, _ = self._loop.run_until_complete(pending)
        return [handle for handle in handles if handle in done]

    def result(self, handle: asyncio.Task[Ended]) -> Ended:
        """Return what became of questions."""
        return handle.result()

    def cancel(self, handle: asyncio.Task[Ended]) -> None:
        """Cancel questions at their next wait."""
        handle.cancel()

    def forget(self, unit: PlannedUnit) -> None:
        """Drop the unit's scene."""
        self._scenes.drop(unit.scene_uri)

    def failed(self, question: Question, error: Exception) -> Tables:
        """Return the records of a failed question."""
        return self._steps.tables(self._steps.failed_rows(question, error, self._work.method))

    def close(self) -> None:
        """End the loop; cancelled questions get to unwind first."""
        left = asyncio.all_tasks(self._loop)
        for task in left:
            task.cancel()
        if left:
            self._loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
        self._loop.run_until_complete(self._steps.close_caller(self._caller))
        self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        self._loop.run_until_complete(self._loop.shutdown_default_executor())
        self._loop.close()

    def _open(self, unit: PlannedUnit) -> _Opened:
        steps, method = self._steps, self._work.method
        start = time.perf_counter()
        scene = steps.load(unit.scene_uri)
        loaded = time.perf_counter()
        found = steps.read_index(scene, method, self._work.visibility)
        context = steps.open_context(scene, None)
        steps.adopt_rows(context, method, found.rows)
        for message in found.damaged:
            self._note("damaged", scene=unit.scene, message=message)
        times = (
            TimingRow("", unit.scene, "load", loaded - start, 1),
            TimingRow("", unit.scene, "index_read", time.perf_counter() - loaded, len(found.rows)),
        )
        return _Opened(context, steps.vocabulary(scene), found.unstored, times)

    async def _answer_all(self, unit: PlannedUnit, questions: Sequence[Question]) -> Ended:
        start = time.perf_counter()
        answers = (self._answer(unit, question) for question in questions)
        results = await asyncio.gather(*answers)
        return Ended(results, time.perf_counter() - start)

    async def _answer(self, unit: PlannedUnit, question: Question) -> Tables | Exception:
        try:
            return await self._records(unit, question)
        except Exception as error:
            return error

    async def _records(self, unit: PlannedUnit, question: Question) -> Tables:
        steps, method = self._steps, self._work.method
        opened = self._scenes.get(unit.scene_uri, lambda: self._open(unit))
        evidence = await steps.find_evidence(question, opened.vocabulary, self._caller, method)
        proposal = steps.propose(opened.context, question, evidence, method)
        steps.keep_rows(opened.context, method, opened.unstored)
        decision = await steps.decide(question, proposal, self._caller, method)
        rows = steps.conclude(opened.context, question, evidence, proposal, decision, method)
        if self._work.images:
            save_thumbnails(self._work.images, steps.thumbnails(proposal, rows))
        tables = steps.tables(rows)
        times, opened.times = opened.times, ()
        return {**tables, "timings": (*times, *tables.get("timings", ()))} if times else tables
