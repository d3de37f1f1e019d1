"""The real driver loop on a simulated disk, by a simulated clock: the driver is killed at every touch of the disk."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.config import JobConfig
from jobs.runs import drive, lock
from jobs.runs.drive import Driven
from jobs.runs.events import EventLog
from jobs.runs.lock import RunLock
from jobs.runs.progress import Silent
from jobs.runs.signals import Stopping
from jobs.runs.submit import submit
from schemas import compaction, local_files
from schemas.manifest import damaged_units
from schemas.plan import PLAN_FILE
from schemas.run_folder import RUN_FILE, RunFolder
from tests.jobs.chaos.measured import Measured, Rows, rows
from tests.jobs.conftest import MakeJob
from tests.schemas.simulated_disk import Inode, PowerCut, SimulatedDisk
from tests.workers.fake_steps import STEPS

TEXTS = ["a", "flaky b", "no evidence", "bug", "cc", "always busy"]
"""Answers, errors and tries that wait."""
CHUNK, BLOCK = 2, 4
"""Questions of a unit, and of a block of units that are merged."""


@dataclass
class Clock:
    """Time that passes only where somebody sleeps."""

    now_s: float = 0.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@dataclass
class Machine:
    """A machine with a run folder that was planned, and nothing done yet."""

    run: str
    config: JobConfig
    disk: SimulatedDisk
    patch: pytest.MonkeyPatch
    clock: Clock = field(default_factory=Clock)
    boots: int = 0

    def boot(self, chance: random.Random, *, power: bool) -> None:
        """Come back after a power cut, or after the driver alone was killed."""
        self.disk.reboot(chance, power=power)
        self.patch.setattr(local_files, "_settled", set())
        self.boots += 1
        # The process that held the run is gone, which the kernel knows.
        started = str(self.boots)
        self.patch.setattr(lock, "_process", lambda pid: lock._Process(started, False))

    def drive(self) -> Driven:
        """Do what the run lacks."""
        events = EventLog(self.run)
        with RunLock(self.run) as held, Stopping(lambda: None) as stopping:
            return drive.drive(RunFolder(self.run), self.config, STEPS, events, Silent(), stopping, held)


@dataclass(frozen=True)
class Planned:
    """A job, its plan and what comes of it undisturbed."""

    config: JobConfig
    files: dict[str, bytes]
    rows: Rows
    touches: int

    def machine(self, patch: pytest.MonkeyPatch) -> Machine:
        """Return a new machine."""
        run = Path(self.config.output)
        disk = SimulatedDisk(run, *run.parents)
        for name, data in self.files.items():
            disk.names[run / name] = Inode(data, data)
        patch.setattr(local_files, "DISK", disk)
        patch.setattr(compaction, "BLOCK_QUESTIONS", BLOCK)
        patch.setattr(lock, "ABANDONED_S", 0.0)
        patch.setattr(lock, "BEAT_S", 1e6)  # a beat falls nowhere, so that the same touches come each time
        machine = Machine(str(run), self.config, disk, patch)
        patch.setattr(drive, "dispatch", partial(drive.dispatch, clock=machine.clock, sleep=machine.clock.sleep))
        machine.boot(random.Random(0), power=False)
        return machine


@pytest.fixture
def planned(make_scene: Callable[..., Path], make_job: MakeJob, monkeypatch: pytest.MonkeyPatch) -> Planned:
    make_scene("a", TEXTS)
    monkeypatch.setattr("workers.dispatch.TICK_S", 0.01)
    monkeypatch.setattr("workers.dispatch.RETRY_WAIT_S", 0.01)
    config = make_job(images=False, workers={"chunk": CHUNK, "retries": 2})
    submit(config, steps=STEPS)
    files = {name: Path(config.output, name).read_bytes() for name in (PLAN_FILE, RUN_FILE)}
    whole = rows(config.output)
    with pytest.MonkeyPatch.context() as patch:
        machine = Planned(config, files, {}, 0).machine(patch)
        before = machine.disk.touches
        assert machine.drive().complete
        assert rows(machine.run) == whole, "the simulated machine does what a real one does"
        return Planned(config, files, whole, machine.disk.touches - before)


def check_kills(planned: Planned, cuts: list[int], power: bool, seed: int) -> None:
    """Kill one driver after the other, each after so many touches, then let one finish."""
    chance, done = random.Random(seed), Rows()
    with pytest.MonkeyPatch.context() as patch:
        machine = planned.machine(patch)
        for cut in cuts:
            machine.disk.cut_at = machine.disk.touches + cut
            with contextlib.suppress(PowerCut):
                machine.drive()
            machine.boot(chance, power=power)
            found = rows(machine.run)
            assert not list(damaged_units(machine.run)), "a crash damages nothing"
            for name, told in found.items():
                assert told in ([], planned.rows[name]), "whatever counts is whole and right"
                assert told or not done.get(name), "what a reader saw stays"
            done = found
        assert machine.drive().complete
        assert rows(machine.run) == planned.rows
        assert machine.clock.now_s > 0, "tries waited, by the simulated clock"


@pytest.mark.chaos("driver kill -9")
def test_driver_killed_at_any_touches_of_the_disk_loses_doubles_and_mixes_nothing(
    planned: Planned, measured: Measured
) -> None:
    points = 0

    @settings(max_examples=12, deadline=None, derandomize=True)
    @given(
        cuts=st.lists(st.integers(0, planned.touches), min_size=1, max_size=3),
        power=st.booleans(),
        seed=st.integers(0, 1 << 16),
    )
    def law(cuts: list[int], power: bool, seed: int) -> None:
        nonlocal points
        points += len(cuts)
        check_kills(planned, cuts, power, seed)

    law()
    measured.equal = len(planned.rows)
    measured.note = f"{points} kills, simulated"


@pytest.mark.slow
@pytest.mark.chaos("driver kill -9")
@pytest.mark.parametrize("power", [True, False], ids=["power cut", "killed"])
def test_driver_killed_at_every_touch_of_the_disk_loses_doubles_and_mixes_nothing(
    planned: Planned, measured: Measured, power: bool
) -> None:
    for cut in range(planned.touches + 1):
        check_kills(planned, [cut], power, cut)
    measured.equal = len(planned.rows)
    measured.note = f"{planned.touches + 1} write points, simulated {'power cut' if power else 'kill'}"
