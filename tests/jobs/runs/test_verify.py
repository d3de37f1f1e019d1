from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from jobs.cli import app
from jobs.runs.lock import RunLock
from jobs.runs.submit import resume, submit
from jobs.runs.verify import verify_run
from schemas import compaction, storage
from schemas.errors import InputError, StopError
from schemas.manifest import commit_unit, committed_units, load_manifest, manifest_uri
from schemas.run_folder import RunFolder, read_table
from tests.jobs.conftest import MakeJob
from tests.workers.fake_steps import STEPS

TEXTS = ["a", "bb", "no evidence", "cc", "d"]


@pytest.fixture
def run(make_scene: Callable[..., Path], make_job: MakeJob) -> str:
    """A complete run of two scenes, five questions each, in four units."""
    make_scene("one", TEXTS)
    make_scene("two", TEXTS)
    return submit(make_job(), steps=STEPS).run


@pytest.fixture
def merged(make_scene: Callable[..., Path], make_job: MakeJob, monkeypatch: pytest.MonkeyPatch) -> str:
    """The same, with every two units merged."""
    monkeypatch.setattr(compaction, "BLOCK_QUESTIONS", 5)
    make_scene("one", TEXTS)
    make_scene("two", TEXTS)
    return submit(make_job(), steps=STEPS).run


def parts_of(run: str, table: str) -> list[Path]:
    return sorted(Path(run, table).glob("*.parquet"))


def test_sound_run_has_nothing_wrong(run: str) -> None:
    found = verify_run(run)
    assert (found.problems, found.orphans) == ([], ())
    assert (found.planned, found.questions, found.units) == (10, 10, 4)
    assert found.rows > 40
    assert found.replies is None
    assert verify_run(run, calls=True).replies == 0


def test_sixty_flipped_bits_are_all_found_and_resume_mends_them(run: str) -> None:
    before, draw = read_table(run, "answers"), random.Random(0)
    parts = [path for table in ("answers", "arms", "candidates") for path in parts_of(run, table)]
    for flip in range(60):
        path = draw.choice(parts)
        whole = path.read_bytes()
        data = bytearray(whole)
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        path.write_bytes(bytes(data))
        problems = verify_run(run).problems
        assert len(problems) == 1
        assert str(path) in problems[0]
        if flip:
            path.write_bytes(whole)
        else:
            assert resume(run, steps=STEPS).driven.complete
            assert verify_run(run).problems == []
    assert read_table(run, "answers").equals(before)


@pytest.mark.parametrize("harm", ["part", "missing part", "block"])
def test_damage_in_merged_files_is_found_and_mended(merged: str, harm: str) -> None:
    before = read_table(merged, "answers")
    assert len(list(Path(merged, "blocks").iterdir())) == 2
    assert not list(Path(merged, "manifests").iterdir())
    path = next(Path(merged, "blocks").iterdir()) if harm == "block" else parts_of(merged, "arms")[0]
    if harm == "missing part":
        path.unlink()
    else:
        path.write_bytes(path.read_bytes()[:-9])
    found = verify_run(merged)
    assert found.questions == 5
    assert [str(path) in problem for problem in found.problems] == [True], "one file is wrong once"
    assert resume(merged, steps=STEPS).driven.complete
    assert verify_run(merged).problems == []
    assert read_table(merged, "answers").equals(before)


def test_changed_plan_and_run_file_are_found(run: str) -> None:
    plan = Path(run, "plan.parquet")
    plan.write_bytes(plan.read_bytes() + b"\0")
    assert any("plan.parquet: sha256" in problem for problem in verify_run(run).problems)
    file = Path(run, "run.json")
    file.write_text(file.read_text().replace('"name": "test"', '"name": "tess"'))
    assert any("run.json: sha256" in problem for problem in verify_run(run).problems)


def test_rows_that_do_not_fit_the_plan_are_found(run: str) -> None:
    units = {unit.id: unit for unit in RunFolder(run).units()}
    for name in committed_units(run):
        Path(manifest_uri(run, name)).unlink()
    first, second = list(units)[:2]
    rows = [row for unit in RunFolder(run).units() for row in _answers(unit.questions)]
    commit_unit(run, first, {"answers": [rows[1], rows[0], rows[2]]})
    commit_unit(run, second, {"answers": [rows[3], rows[3]]})
    commit_unit(run, "f" * 32, {"answers": rows[:1]})
    problems = "\n".join(verify_run(run).problems)
    assert f"unit {first}: question_id: expected one row for each of 3 planned" in problems
    assert f"unit {second}: method, question_id: expected each once" in problems
    assert f"manifests/{'f' * 32}.json: expected a unit of the plan" in problems


def _answers(questions: object) -> list[object]:
    from tests.workers.fake_steps import answer

    return [answer(question) for question in questions]  # type: ignore[attr-defined]


def test_orphans_are_counted_and_removed_when_asked(run: str) -> None:
    unit = committed_units(run)[0]
    kept = {path: path.read_bytes() for path in Path(run).rglob("*") if path.is_file()}
    left = [f"answers/{unit}-000000000000.parquet", "arms/.x.parquet.abc.tmp", "manifests/.x.json.abc.tmp"]
    for name in left:
        Path(run, name).write_bytes(b"cut off")
    assert verify_run(run).orphans == tuple(sorted(left))
    assert verify_run(run).problems == []
    verify_run(run, clean=True)
    found = {path: path.read_bytes() for path in Path(run).rglob("*") if path.is_file() and "driver" not in path.parts}
    assert found == {path: data for path, data in kept.items() if "driver" not in path.parts}


def test_nothing_is_removed_while_a_driver_is_at_work(run: str) -> None:
    Path(run, "answers", "x.parquet").write_bytes(b"")
    with RunLock(run), pytest.raises(StopError, match="another driver is at work"):
        verify_run(run, clean=True)
    assert Path(run, "answers", "x.parquet").exists()


def test_damaged_stored_reply_and_result_are_named(run: str) -> None:
    reply = Path(run, "calls", "ab", "ab" + "0" * 62 + ".json")
    reply.parent.mkdir(parents=True, exist_ok=True)
    reply.write_text("{")
    result = Path(run, "results", "answers.parquet")
    result.write_bytes(result.read_bytes()[:-5])
    assert [
        path in problem
        for path, problem in zip((str(result), str(reply)), verify_run(run, calls=True).problems, strict=True)
    ]
    assert len(verify_run(run).problems) == 1, "replies are read when asked for"


def test_command_exits_1_for_damage_and_2_for_no_run(run: str, tmp_path: Path) -> None:
    good = CliRunner().invoke(app, ["verify", run])
    assert good.exit_code == 0
    assert "questions: 10 of 10 committed" in good.output
    assert "nothing is damaged" in good.output
    path = storage.join(run, load_manifest(run, committed_units(run)[0]).parts["arms"].path)
    Path(path).unlink()
    bad = CliRunner().invoke(app, ["verify", run])
    assert bad.exit_code == 1
    assert f"damaged: {path}" in bad.output
    assert "splatreasoner resume" in bad.output
    with pytest.raises(InputError, match=r"expected a run folder with run.json"):
        verify_run(tmp_path)
    (tmp_path / "run.json").write_text(json.dumps([]))
    assert len(verify_run(tmp_path).problems) >= 1
