"""Build runs: captures as units with the plan, commits, resume, status and signals of questions."""

from __future__ import annotations

import json
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jobs.builds.build_captures import resume_build, submit_build
from jobs.builds.build_job import BuildJob
from jobs.runs.retry import retry
from jobs.runs.status import run_status
from jobs.runs.submit import resume
from jobs.runs.verify import verify_run
from schemas.builds import BUILD_STATUSES
from schemas.errors import InputError
from schemas.manifest import committed_units
from schemas.plan_columns import plan_table
from schemas.question_file import save_questions
from schemas.run_folder import RunFolder, read_table
from tests.jobs.faults import driver, ended, job_file, result_bytes, wait_until
from tests.scene.box_room import write_seven_scenes
from tests.workers.fake_builds import MARKS, STEP_S, STEPS, fake_build, steps_done
from tests.workers.fake_steps import unit

DRIVER = "tests.jobs.run_fake_build"

MakeJob = Callable[..., BuildJob]


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_seven_scenes(tmp_path_factory.mktemp("frames"))


@pytest.fixture
def marks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "marks"
    folder.mkdir()
    monkeypatch.setenv(MARKS, str(folder))
    return folder


@pytest.fixture
def make_job(tmp_path: Path, frames: Path, marks: Path) -> MakeJob:
    """Make a job over captures of the given names, built in this process unless told otherwise."""

    def make(names: list[str], run: str = "run", **changes: Any) -> BuildJob:
        for name in names:
            shutil.copytree(frames, tmp_path / "captures" / name, dirs_exist_ok=True)
        workers = {"in_process": True, "cpus": 2, **changes.pop("workers", {})}
        paths = [str(tmp_path / "captures" / name) for name in names]
        values = {"name": "test", "output": str(tmp_path / run), "captures": paths, "workers": workers, **changes}
        return BuildJob.model_validate(values)

    return make


def test_every_capture_becomes_a_row_in_plan_order_and_nothing_is_left_behind(make_job: MakeJob, marks: Path) -> None:
    job = make_job(["b", "a", "wrong", "bug", "lost"])
    result = submit_build(job, build=fake_build)
    assert result.driven.complete
    assert result.driven.failed == 2
    rows = read_table(job.output, "builds")
    assert list(rows["scene"]) == ["b", "a", "wrong", "bug", "lost"]
    assert list(rows["status"]) == ["built", "built", "failed", "failed", "built"]
    assert set(rows["status"]) == set(BUILD_STATUSES)
    assert rows["reason"][2].startswith("InputError: ")
    assert rows["reason"][3] == "ZeroDivisionError: a bug"
    assert rows["psnr"].isna().tolist() == [False, False, True, True, False]
    assert Path(job.output, "scenes", "b", "scene.json").read_text() == "b"
    assert list(read_table(job.output, "timings")["scene"]) == ["b", "a", "lost"]
    assert list(result_bytes(job.output)) == ["builds.parquet"]
    assert not Path(job.output, "working").exists()
    status = run_status(job.output)
    assert (status.items, status.units_done, dict(status.statuses)) == ("captures", 5, {"built": 3, "failed": 2})
    assert dict(status.retries) == {"RetryError": 1}
    assert not verify_run(job.output).problems


def test_the_same_job_again_builds_nothing_and_another_is_refused_with_what_differs(
    make_job: MakeJob, marks: Path
) -> None:
    job = make_job(["a"])
    submit_build(job, build=fake_build)
    assert submit_build(job, build=fake_build).driven.complete
    assert steps_done(marks, "a") == list(range(STEPS))
    with pytest.raises(InputError, match="one that differs in") as refused:
        submit_build(make_job(["a"], build={"frames": 3}), build=fake_build)
    assert any("build.frames: None then, 3 now" in note for note in refused.value.__notes__)
    with pytest.raises(InputError, match="one that differs in") as refused:
        submit_build(make_job(["a", "b"]), build=fake_build)
    assert any("captures.b: nothing then" in note for note in refused.value.__notes__)


def test_a_capture_that_changed_since_it_was_planned_is_not_built(make_job: MakeJob, tmp_path: Path) -> None:
    job = make_job(["a", "bug"])
    submit_build(job, build=fake_build)
    assert retry(job.output, status="failed").questions == 1
    assert run_status(job.output).units_done == 1
    pose = tmp_path / "captures" / "bug" / "frame-000000.pose.txt"
    text = pose.read_text()
    pose.write_text(text.replace("1", "2", 1))
    assert len(pose.read_text()) == len(text)
    with pytest.raises(InputError, match="the capture as it was planned"):
        resume_build(job.output, build=fake_build)


def test_everything_that_is_wrong_with_a_job_is_told_before_anything_is_built(
    make_job: MakeJob, tmp_path: Path
) -> None:
    job = make_job(["a"])
    entries = [
        *job.model_dump()["captures"],
        {"path": str(tmp_path / "gone")},
        {"path": str(tmp_path / "none*")},
        {"path": str(tmp_path / "captures" / "a"), "name": "a"},
    ]
    save_questions(unit(0, ["q"], "other").questions, tmp_path / "questions.jsonl")
    changes = {"captures": entries, "questions": str(tmp_path / "questions.jsonl")}
    with pytest.raises(InputError) as refused:
        submit_build(BuildJob.model_validate({**job.model_dump(), **changes}), build=fake_build)
    told = "\n".join([str(refused.value), *refused.value.__notes__])
    assert f"{tmp_path / 'gone'}: expected a capture" in told
    assert "a pattern that matches captures" in told
    assert "scenes of distinct names" in told
    assert "questions about one of a, found other" in told
    assert not Path(job.output).exists()


@pytest.mark.parametrize("in_process", [True, False], ids=["in process", "on Ray"])
def test_killed_driver_resumes_from_the_checkpoint_to_the_same_rows(
    make_job: MakeJob, tmp_path: Path, marks: Path, in_process: bool
) -> None:
    scenes = str(tmp_path / "scenes")
    whole = make_job(["a", "b", "c"], "whole", scenes=scenes)
    submit_build(whole, build=fake_build)
    shutil.rmtree(marks)
    marks.mkdir()
    job = make_job(["a", "b", "c"], "killed", scenes=scenes, workers={"in_process": in_process})
    with driver("submit", job_file(job, tmp_path), DRIVER, **{STEP_S: "0.1"}) as process:
        wait_until(lambda: len(committed_units(job.output)) >= 1, process, "a commit")
        wait_until(lambda: len(steps_done(marks, "c")) >= 3, process, "steps of the last capture")
        process.send_signal(signal.SIGKILL)
    before, done = run_status(job.output), {name: len(steps_done(marks, name)) for name in "abc"}
    assert 1 <= before.units_done < 3
    assert any(line.startswith("c: train") for line in before.at_work)

    assert resume_build(job.output, build=fake_build, workers={"in_process": True}).driven.complete
    assert result_bytes(job.output) == result_bytes(whole.output)
    for name in "abc":
        assert set(steps_done(marks, name)) == set(range(STEPS))
        # At most the step that was under way is done twice: nothing that a checkpoint held.
        again = steps_done(marks, name, here=True)
        assert again == list(range(STEPS - len(again), STEPS))
        assert len(again) <= STEPS - done[name] + 1


@pytest.mark.parametrize(
    "in_process", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["in process", "on Ray"]
)
def test_interrupted_run_keeps_what_each_capture_has_and_exits_130(
    make_job: MakeJob, tmp_path: Path, marks: Path, in_process: bool
) -> None:
    job = make_job(["a", "b"], workers={"in_process": in_process})
    with driver("submit", job_file(job, tmp_path), DRIVER, **{STEP_S: "0.3"}) as process:
        wait_until(lambda: len(steps_done(marks, "a")) >= 2, process, "steps")
        process.send_signal(signal.SIGINT)
        code, said = ended(process)
    assert code == 130, said
    assert "stopping: each capture keeps what it has" in said
    assert "Traceback" not in said
    status = run_status(job.output)
    assert not status.complete
    assert not status.failures
    assert not status.retries
    done = len(steps_done(marks, "a"))
    assert 2 <= done < STEPS
    assert resume_build(job.output, build=fake_build, workers={"in_process": True}).driven.complete
    assert steps_done(marks, "a") == list(range(STEPS)), "not one step was done twice"


def test_damaged_part_is_found_by_verify_and_built_again_from_nothing_but_the_run(
    make_job: MakeJob, marks: Path
) -> None:
    job = make_job(["a", "b"])
    submit_build(job, build=fake_build)
    part = next(Path(job.output, "builds").iterdir())
    part.write_bytes(part.read_bytes()[:-1] + b"?")
    assert verify_run(job.output).problems
    assert resume_build(job.output, build=fake_build).driven.complete
    assert not verify_run(job.output).problems
    assert sorted(len(steps_done(marks, name)) for name in "ab") == [STEPS, 2 * STEPS]


def test_a_build_run_is_no_run_of_answers_and_the_other_way_round(make_job: MakeJob, tmp_path: Path) -> None:
    job = make_job(["a"])
    submit_build(job, build=fake_build)
    with pytest.raises(InputError, match="one that builds scenes"):
        resume(job.output)
    with pytest.raises(InputError, match="one of this run's: builds and timings"):
        read_table(job.output, "answers")
    with pytest.raises(InputError, match="one that builds scenes"):
        plan_table(job.output, ["question_id"])
    run = Path(job.output, "run.json")
    run.write_text(json.dumps({**json.loads(run.read_text()), "kind": "questions"}))
    with pytest.raises(InputError, match="one that answers questions"):
        resume_build(job.output)


def test_runs_that_share_a_working_folder_leave_each_other_alone(make_job: MakeJob, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    other = shared / "another-run" / "unit" / "checkpoint"
    other.parent.mkdir(parents=True)
    other.touch()
    job = make_job(["a", "lost"], working=str(shared))
    assert submit_build(job, build=fake_build).driven.complete
    assert [path for path in shared.rglob("*") if path.is_file()] == [other]
    assert run_status(job.output).at_work == ()


def test_moved_run_goes_on_where_it_lies(make_job: MakeJob, tmp_path: Path) -> None:
    job = make_job(["a", "bug"], scenes=str(tmp_path / "scenes"))
    submit_build(job, build=fake_build)
    moved = Path(job.output).rename(tmp_path / "moved")
    retry(moved, status="failed")
    assert resume_build(moved, build=fake_build).run == str(moved)
    assert [unit.scene for unit in RunFolder(str(moved)).captures()] == ["a", "bug"]
