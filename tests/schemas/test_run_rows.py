"""Rows of single questions: those of the whole table, from loose parts and from merged ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from schemas import storage
from schemas.compaction import compact
from schemas.errors import InputError
from schemas.manifest import commit_unit
from schemas.plan import PLAN_FILE, encode_plan
from schemas.run_folder import RunFolder, read_table
from schemas.run_rows import RunRows
from tests.workers.fake_steps import answer, arm, unit

UNITS = [unit(index, ["a", "b", "c"]) for index in range(4)]


@pytest.fixture(params=["loose", "merged"])
def run(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A run of four units of three questions; the last is not committed."""
    folder = RunFolder(str(tmp_path))
    storage.write_bytes_atomic(folder.uri(PLAN_FILE), encode_plan(UNITS))
    folder.write_run({"name": "test"})
    for one in UNITS[:3]:
        arms = [arm(question, name) for question in one.questions for name in ("initial", "final")]
        commit_unit(folder.root, one.id, {"answers": [answer(q) for q in one.questions], "arms": arms})
    if request.param == "merged":
        compact(folder.root, [one.id for one in UNITS[:2]])
    return folder.root


@pytest.mark.parametrize("name", ["answers", "arms", "regions"])
def test_rows_of_questions_are_those_of_the_whole_table(run: str, name: str) -> None:
    wanted = ["scene1-2", "scene0-0", "scene0-1", "scene2-0"]
    whole, rows = read_table(run, name), RunRows(run).of(wanted, name)
    assert sorted(rows["question_id"]) == sorted(whole[whole["question_id"].isin(wanted)]["question_id"])
    rows = rows.set_index("question_id", drop=False)
    for question in set(rows["question_id"]):
        kept = whole[whole["question_id"] == question].set_index("question_id", drop=False)
        assert rows[rows["question_id"] == question].equals(kept), "in the order they arose, with their types"


def test_rows_of_questions_that_are_not_committed_or_not_planned_are_none(run: str) -> None:
    assert not len(RunRows(run).of(["scene3-0", "no such question"], "answers"))
    assert list(RunRows(run).of([], "arms", ("question_id", "arm")).columns) == ["question_id", "arm"]


def test_rows_open_only_the_parts_that_hold_them(run: str) -> None:
    for part in Path(run, "arms").iterdir():
        if part.name.startswith(UNITS[2].id):
            part.write_bytes(b"damaged")
    rows = RunRows(run)
    assert len(rows.of(["scene0-0"], "arms")) == 2
    with pytest.raises(InputError, match="sha256"):
        rows.of(["scene2-0"], "arms")
