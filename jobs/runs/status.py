"""How far a run is, from its folder alone.

Read are run.json, one column of the plan, the manifests, the diary, the parts that hold failed questions and, up to
`spend.JOURNALS_READ` bytes, the journals of model calls. Failures are those that stand: of committed rows, and of units
under way what the diary tells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jobs.runs.events import read_events
from jobs.runs.failures import Ended, FailedRows, Failure, by_error
from jobs.runs.lock import driver_alive, read_holder
from jobs.runs.spend import CallTotals, Paid, paid
from schemas import storage
from schemas.committed import Committed
from schemas.plan_columns import unit_sizes
from schemas.run_folder import RunFolder, is_build_run

RECENT_S = 600.0
"""Commits this old, counted from the latest, give the recent rate: units end in bursts, and a run changes its pace."""


@dataclass(frozen=True, slots=True)
class RunStatus:
    """How far a run is."""

    name: str
    """Name of the run."""
    units: int
    """Units planned."""
    units_done: int
    """Units committed."""
    questions: int
    """Questions planned."""
    questions_done: int
    """Questions in committed units."""
    statuses: Mapping[str, int]
    """Committed questions by status: answered, unparsed, failed, skipped."""
    failures: tuple[Failure, ...]
    """Failed questions by error, most frequent first; those of units under way included."""
    retries: Mapping[str, int]
    """Tries beyond the first, by error, in all sessions."""
    running: bool
    """A driver is at work."""
    driver: str
    """Who drives it, or did last: process and machine; empty before the first session."""
    session: int
    """Sessions so far, the one under way included."""
    begun: str
    """When the latest session began, as the diary says; empty before the first."""
    quiet_s: float | None
    """Seconds since the diary's last line; None when it has none."""
    per_minute: float | None
    """Committed questions a minute in the latest session; None before its first commit."""
    recent_per_minute: float | None
    """The same over the last `RECENT_S` before the latest commit; None with fewer than two commits in it."""
    calls: CallTotals | None
    """Model calls of committed units in all sessions; None where the diary does not tell."""
    paid: Paid | None
    """What the journals say was sent to endpoints, lost work included; None where there are none or too much."""
    items: str
    """What is counted: questions, or captures of a run that builds scenes; then fields named after questions are
    about captures."""
    at_work: tuple[str, ...]
    """How far the captures are that have begun and are not committed; empty for questions."""

    @property
    def complete(self) -> bool:
        """Whether every unit is committed."""
        return self.units_done == self.units

    @property
    def minutes_left(self) -> float | None:
        """Minutes the rest takes at the recent rate, or at the session's; None when neither is known."""
        rate = self.recent_per_minute or self.per_minute
        return (self.questions - self.questions_done) / rate if rate else None

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {**asdict(self), "complete": self.complete, "minutes_left": self.minutes_left}


def run_status(run: str, rows: FailedRows | None = None) -> RunStatus:
    """Return how far a run is.

    Args:
        run: Run folder, a path or URI.
        rows: Its failed questions as they were known at an earlier look; None for the first look.

    Raises:
        InputError: There is no such run, or its plan or a manifest cannot be read.
    """
    folder = RunFolder(run)
    found = folder.read_run()
    builds = is_build_run(found)
    sizes = unit_sizes(run)
    done, statuses = dict[str, int](), Counter[str]()
    committed = Committed.load(run)
    for unit in committed.units:
        if unit in sizes:
            manifest = committed.manifest(unit)
            done[unit] = manifest.questions
            statuses.update(manifest.statuses)
    holder, diary = read_holder(run), _Diary()
    diary.read(read_events(run))
    return RunStatus(
        name=str(found.get("name")),
        units=len(sizes),
        units_done=len(done),
        questions=sum(sizes.values()),
        questions_done=sum(done.values()),
        statuses=dict(sorted(statuses.items())),
        failures=by_error([*(rows or FailedRows(run)).read(committed, done), *diary.under_way(done)]),
        retries=dict(diary.retries.most_common()),
        running=driver_alive(run),
        driver="" if holder is None else str(holder),
        session=0 if holder is None else holder.epoch,
        begun="" if diary.begun is None else diary.begun.isoformat(),
        quiet_s=diary.quiet_s(),
        per_minute=_rate([(diary.begun, 0), *diary.session]) if diary.begun else None,
        recent_per_minute=_rate(_recent(diary.session)),
        calls=diary.calls,
        paid=_paid(folder, found),
        items="captures" if builds else "questions",
        at_work=_at_work(folder) if builds else (),
    )


@dataclass(slots=True)
class _Diary:
    """What the diary says of the run as it stands."""

    begun: datetime | None = None
    last: datetime | None = None
    session: list[tuple[datetime, int]] = field(default_factory=list)
    """Commits of the latest session: when, and how many questions."""
    retries: Counter[str] = field(default_factory=Counter)
    calls: CallTotals | None = None
    failed: dict[str, dict[str, Ended]] = field(default_factory=dict)
    """Failed questions by unit and id, of units that the latest session has not committed."""

    def read(self, events: Iterable[Mapping[str, Any]]) -> None:
        for event in events:
            try:
                now = datetime.fromisoformat(str(event.get("time")))
            except ValueError:
                continue  # nobody of ours wrote that line
            kind, unit, self.last = event.get("event"), str(event.get("unit", "")), now
            if kind == "failed" and unit:  # without one it is of an early version, whose rows tell
                question = str(event.get("question", ""))
                told = Ended(question, str(event.get("error", "")), str(event.get("message", "")))
                self.failed.setdefault(unit, {})[question] = told
            elif kind == "retry":
                self.retries[str(event.get("error", ""))] += 1
            elif kind == "started":
                self.begun, self.session = now, []
                self.failed.clear()  # the session before ended with these under way: they are done anew
            elif kind == "committed":
                self.session.append((now, int(event.get("questions", 0))))
                self.failed.pop(unit, None)
                if isinstance(event.get("calls"), dict):
                    self.calls = (self.calls or CallTotals()) + CallTotals.read(event["calls"])

    def under_way(self, done: Collection[str]) -> Iterator[Ended]:
        """Yield the failed questions of units that are not committed; a diary in an object store lags behind those."""
        for unit, failed in self.failed.items():
            if unit not in done:
                yield from failed.values()

    def quiet_s(self) -> float | None:
        return None if self.last is None else max(0.0, (datetime.now(UTC) - self.last).total_seconds())


def _at_work(folder: RunFolder) -> tuple[str, ...]:
    from jobs.builds.build_captures import captures_at_work

    return tuple(map(str, captures_at_work(folder)))


def _recent(commits: list[tuple[datetime, int]]) -> list[tuple[datetime, int]]:
    return [c for c in commits if (commits[-1][0] - c[0]).total_seconds() <= RECENT_S]


def _rate(commits: list[tuple[datetime, int]]) -> float | None:
    """Return questions a minute between the first moment and the last; the first one's questions came before it."""
    if len(commits) < 2:
        return None
    minutes = (commits[-1][0] - commits[0][0]).total_seconds() / 60
    return sum(questions for _, questions in commits[1:]) / minutes if minutes > 0 else None


def _paid(folder: RunFolder, found: Mapping[str, Any]) -> Paid | None:
    """Return what the run's journals say, which lie beside the stored replies."""
    from jobs.runs.drive import JOURNALS

    config = found.get("config")
    calls = config.get("calls") if isinstance(config, dict) else None
    where = storage.local_path(str(calls) if calls else folder.uri("calls"))
    return None if where is None else paid(str(Path(where, JOURNALS, folder.identity())))
