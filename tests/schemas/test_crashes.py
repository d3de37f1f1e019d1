"""Commit, discard and merge under a simulated disk: the power goes at every touch, drivers race, readers look on."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas import compaction, local_files
from schemas.committed import Committed, PartReader
from schemas.compaction import Compactor
from schemas.manifest import commit_unit, damaged_units, discard_unit
from tests.schemas.simulated_disk import PowerCut, SimulatedDisk, Turns
from tests.workers.fake_steps import answer, arm, unit

RUN = "/run"
UNITS = [unit(index, ["a", "b"]) for index in range(5)]
SIZES = [(u.id, len(u.questions)) for u in UNITS]
REDONE = UNITS[1].id
"""The unit that is taken back and done again once."""

Rows = dict[str, dict[str, list[Any]]]


def rows_of(index: int, author: str = "") -> dict[str, list[Any]]:
    questions = UNITS[index].questions
    return {
        "answers": [answer(question, answer=author) for question in questions],
        "arms": [arm(question, "final", answer=author) for question in questions],
    }


def read_all() -> Rows:
    """Everything committed, as a reader finds it."""
    committed, reader = Committed.load(RUN), PartReader(RUN)
    return {
        unit: {table: committed.read(reader, unit, table).to_pylist() for table in ("answers", "arms")}
        for unit in committed.units
    }


def drive(acknowledged: set[tuple[str, int]]) -> None:
    """A driver that resumes: redo what is damaged, do what lacks, and one unit a second time."""
    for found in damaged_units(RUN):
        discard_unit(RUN, found.unit, generation=found.generation)
        acknowledged -= {done for done in acknowledged if found.unit in (done[0], compaction.block_id(block_of(done)))}
    for generation in (0, 1):
        compactor, committed = Compactor(RUN, SIZES), Committed.load(RUN)
        for index, (name, _) in enumerate(SIZES):
            if name not in committed:
                manifest = commit_unit(RUN, name, rows_of(index)).manifest
                acknowledged.add((name, manifest.generation))
                compactor.committed(name)
        if generation == 0 and Committed.load(RUN).generation(REDONE) == 0:
            discard_unit(RUN, REDONE, generation=0)
            acknowledged.discard((REDONE, 0))


def block_of(done: tuple[str, int]) -> list[str]:
    index = [name for name, _ in SIZES].index(done[0]) // 2 * 2
    return [name for name, _ in SIZES[index : index + 2]]


@pytest.fixture(scope="module")
def whole() -> Iterator[tuple[Rows, int]]:
    """The rows of a run that nothing befell, and how often it touched the disk."""
    with pytest.MonkeyPatch.context() as patch:
        disk = new_disk(patch)
        drive(set())
        yield read_all(), disk.touches


def new_disk(patch: pytest.MonkeyPatch) -> SimulatedDisk:
    disk = SimulatedDisk(Path(RUN))
    patch.setattr(local_files, "DISK", disk)
    patch.setattr(local_files, "_settled", set())
    patch.setattr(compaction, "BLOCK_QUESTIONS", 4)
    return disk


def check_crashes(cuts: list[int], power: bool, seed: int, whole: Rows, rot: bool = False) -> None:
    """Cut the power at each of several points of a driver and its successors, then let one finish."""
    chance, acknowledged = random.Random(seed), set[tuple[str, int]]()
    with pytest.MonkeyPatch.context() as patch:
        disk = new_disk(patch)
        for cut in cuts:
            disk.cut_at = disk.touches + cut
            with contextlib.suppress(PowerCut):
                drive(acknowledged)
            disk.reboot(chance, power=power)
            patch.setattr(local_files, "_settled", set())
            found, committed = read_all(), Committed.load(RUN)
            assert not list(damaged_units(RUN)), "a crash damages nothing"
            assert {name for name, _ in acknowledged} <= set(found) | {REDONE}, "what was acknowledged stays"
            for name, rows in found.items():
                assert rows == whole[name], "whatever counts is whole and right"
                kept = [generation for done, generation in acknowledged if done == name]
                assert committed.generation(name) >= max(kept, default=0)
        parts = sorted(path for path, inode in disk.names.items() if inode and path.name.endswith(".parquet"))
        if rot and parts and (inode := disk.names[chance.choice(parts)]) is not None:
            inode.data = inode.synced = inode.data[: len(inode.data) // 2]
        drive(acknowledged)
        assert read_all() == whole
        assert not list(damaged_units(RUN))


@settings(max_examples=15, deadline=None)
@given(
    cuts=st.lists(st.integers(0, 400), min_size=1, max_size=3),
    power=st.booleans(),
    seed=st.integers(0, 1 << 16),
    rot=st.booleans(),
)
def test_crash_at_any_touch_loses_doubles_and_mixes_nothing(
    cuts: list[int], power: bool, seed: int, rot: bool, whole: tuple[Rows, int]
) -> None:
    check_crashes(cuts, power, seed, whole[0], rot)


@pytest.mark.slow
@pytest.mark.parametrize("power", [True, False], ids=["power cut", "killed"])
def test_crash_at_every_touch_loses_doubles_and_mixes_nothing(whole: tuple[Rows, int], power: bool) -> None:
    rows, touches = whole
    for cut in range(touches + 1):
        for seed in range(5 if power else 1):
            check_crashes([cut], power, seed, rows)


def check_race(seed: int) -> None:
    """Two drivers do the same run at once, each with rows of its own, while a reader looks again and again."""
    chance, seen, winners = random.Random(seed), dict[str, str](), dict[str, str]()

    def work(author: str) -> None:
        compactor = Compactor(RUN, SIZES)
        for index, (name, _) in enumerate(SIZES):
            commit = commit_unit(RUN, name, rows_of(index, author), epoch=ord(author))
            assert commit.won == (commit.manifest.epoch == ord(author))
            if commit.won and name in Committed.load(RUN).loose:
                assert winners.setdefault(name, author) == author, "one wins"
            compactor.committed(name)

    def look() -> None:
        for _ in range(4):
            found = read_all()
            assert set(seen) <= set(found), "a reader who saw a unit sees it again"
            for name, tables in found.items():
                authors = {row["answer"] for rows in tables.values() for row in rows}
                assert len(authors) == 1, "rows of two drivers are never mixed"
                assert [row["question_id"] for row in tables["answers"]] == [f"scene{name[-1]}-{i}" for i in (0, 1)]
                assert seen.setdefault(name, *authors) in authors, "who was first stays first"

    with pytest.MonkeyPatch.context() as patch:
        Turns(new_disk(patch), chance).run(lambda: work("A"), lambda: work("B"), look)
        look()
        assert set(seen) == {name for name, _ in SIZES}
        Compactor(RUN, SIZES)
        look()


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1 << 30))
def test_two_drivers_at_once_leave_one_answer_each_and_a_reader_never_misses_one(seed: int) -> None:
    check_race(seed)


@pytest.mark.slow
def test_two_drivers_in_many_orders() -> None:
    for seed in range(500):
        check_race(seed)
