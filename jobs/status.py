"""How far a run is, from its folder alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from jobs.events import read_events
from jobs.lock import driver_alive
from schemas.manifest import committed_units, load_manifest
from schemas.run_folder import RunFolder


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
    reasons: Mapping[str, int]
    """Failed questions by error and message, most frequent first, as the diary tells; those redone later included."""
    retries: int
    """Tries beyond the first."""
    running: bool
    """A driver is at work."""
    per_minute: float | None
    """Committed questions a minute in the latest session; None before its first commit."""

    @property
    def complete(self) -> bool:
        """Whether every unit is committed."""
        return self.units_done == self.units

    @property
    def minutes_left(self) -> float | None:
        """Minutes the rest takes at the latest session's rate; None when that is unknown."""
        return None if not self.per_minute else (self.questions - self.questions_done) / self.per_minute


def run_status(run: str) -> RunStatus:
    """Return how far a run is.

    Raises:
        InputError: There is no such run.
    """
    folder = RunFolder(run)
    name = folder.read_run()["name"]
    committed = set(committed_units(run))
    units = questions = done = done_questions = 0
    statuses: Counter[str] = Counter()
    for unit in folder.units():
        units += 1
        questions += len(unit.questions)
        if unit.id in committed:
            manifest = load_manifest(run, unit.id)
            done += 1
            done_questions += manifest.questions
            statuses.update(manifest.statuses)
    reasons: Counter[str] = Counter()
    retries, begun, session = 0, "", list[tuple[str, int]]()
    for event in read_events(run):
        kind = event.get("event")
        if kind == "failed":
            reasons[f"{event.get('error')}: {event.get('message', '')}"] += 1
        elif kind == "retry":
            retries += 1
        elif kind == "started":
            begun, session = str(event["time"]), []
        elif kind == "committed":
            session.append((str(event["time"]), int(event["questions"])))
    return RunStatus(
        name=str(name),
        units=units,
        units_done=done,
        questions=questions,
        questions_done=done_questions,
        statuses=dict(statuses),
        reasons=dict(reasons.most_common()),
        retries=retries,
        running=driver_alive(run),
        per_minute=_rate(begun, session),
    )


def _rate(begun: str, commits: list[tuple[str, int]]) -> float | None:
    if not begun or not commits:
        return None
    minutes = (datetime.fromisoformat(commits[-1][0]) - datetime.fromisoformat(begun)).total_seconds() / 60
    return sum(questions for _, questions in commits) / minutes if minutes > 0 else None
