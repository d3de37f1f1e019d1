from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jobs.config import JobConfig
from jobs.runs.results import write_results
from jobs.runs.submit import in_another_folder, resume, submit
from schemas.errors import InputError, StopError
from schemas.manifest import committed_units, manifest_uri
from schemas.question_file import save_questions
from schemas.run_folder import RunFolder, image_name, read_table
from tests.jobs.conftest import MakeJob
from tests.models.counting_server import CountingServer
from tests.workers import calling_steps
from tests.workers.fake_steps import POSE, STEPS, Tables, unit

MakeScene = Callable[..., Path]


def notes(error: Exception) -> list[str]:
    return list(error.__notes__)


def never(*arguments: Any) -> Any:
    raise AssertionError("this step should not run")


NO_STEPS = dataclasses.replace(STEPS, load=never, make_caller=never)


def test_run_folder_holds_what_the_design_names(make_scene: MakeScene, make_job: MakeJob, tmp_path: Path) -> None:
    make_scene("a", ["q", "no evidence", "z", "y"])
    result = submit(make_job(), steps=STEPS)
    folder = Path(result.run)
    assert (result.driven.planned, result.driven.done, result.driven.failed) == (4, 4, 1)
    names = {path.name for path in folder.iterdir()}
    assert names >= {"run.json", "plan.parquet", "answers", "arms", "manifests", "events.jsonl", "images", "results"}
    assert (folder / image_name("a", "f/0/left", POSE)).is_file()
    run = RunFolder(result.run).read_run()
    assert run["config"]["workers"]["chunk"] == 3
    assert run["versions"]["numpy"]
    assert set(run["basis"]["prompts"]) >= {"evidence", "judge"}
    answers = read_table(result.run, "answers")
    assert list(answers["question_id"]) == ["a-0", "a-1", "a-2", "a-3"]
    assert list(answers["status"]) == ["answered", "failed", "answered", "answered"]
    assert str(read_table(result.run, "arms")["mark"].dtype) == "Int32"
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    assert [e["event"] for e in events if e["event"] != "failed"] == ["started", "committed", "committed", "ended"]


def test_submitting_the_same_job_again_runs_nothing(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q"])
    submit(make_job(), steps=STEPS)
    assert submit(make_job(), steps=NO_STEPS).driven.complete


def test_other_job_in_the_same_folder_is_refused(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q", "z"])
    submit(make_job(), steps=STEPS)
    changed = make_job(limit=1, method={"novel_views": {"count": 8}}, tasks=["eqa"], workers={"chunk": 7})
    with pytest.raises(InputError, match="expected an empty folder or a run of this very job") as refused:
        submit(changed, steps=STEPS)
    told = notes(refused.value)
    assert told[:5] == [
        "  limit: None then, 1 now",
        "  tasks: ['eqa', 'ground_one', 'ground_many'] then, ['eqa'] now",
        "  workers.chunk: 3 then, 7 now",
        "  method.novel_views.count: 4 then, 8 now",
        "  unit 0: question a-1 then, nothing now",
    ]
    assert told[-1] == "  splatreasoner submit JOB.yaml --output ANOTHER_FOLDER"


def test_same_job_over_data_that_changed_is_refused_by_what_changed(make_scene: MakeScene, make_job: MakeJob) -> None:
    scene = make_scene("a", ["q", "z"])
    submit(make_job(), steps=STEPS)
    save_questions(unit(0, ["q", "why"], "a").questions, scene / "questions.jsonl")
    with pytest.raises(InputError) as refused:
        submit(make_job(), steps=STEPS)
    assert notes(refused.value)[0] == "  question a-1.question: 'z' then, 'why' now"
    (scene / "gaussians.ply").write_bytes(b"other splats")
    with pytest.raises(InputError) as refused:
        submit(make_job(), steps=STEPS)
    assert notes(refused.value)[0] == "  unit 0: the files of scene a have changed"


def test_settings_that_change_no_answer_are_no_other_job(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q"])
    submit(make_job(), steps=STEPS)
    same = make_job(name="renamed", budget={"calls": 9}, workers={"retries": 5}, images=False)
    assert submit(same, steps=NO_STEPS).driven.complete


def test_changed_job_in_another_folder_pays_only_for_what_changed(make_scene: MakeScene, make_job: MakeJob) -> None:
    texts = ["one", "two", "three"]
    scene = make_scene("a", texts)
    with CountingServer() as server:
        endpoint = {"kind": "openai", "base_url": server.base_url, "model": "m", "max_tokens": 50}
        job = make_job(models={"endpoints": {"e": endpoint}, "default": "e"})
        submit(job, steps=calling_steps.STEPS)
        paid = server.sent
        assert paid == len(texts) * (calling_steps.CALLS - 1) + 1
        again = in_another_folder(job.model_copy(update={"limit": 2}), f"{job.output}2")
        assert submit(again, steps=calling_steps.STEPS).driven.complete
        assert server.sent == paid, "equal calls are found where the first run keeps them"
        save_questions(unit(0, [*texts, "four"], "a").questions, scene / "questions.jsonl")
        longer = in_another_folder(job, f"{job.output}3")
        assert submit(longer, steps=calling_steps.STEPS).driven.done == 4
        assert server.sent == paid + calling_steps.CALLS - 1
    assert len(read_table(job.output, "answers")) == 3, "the first run is as it was"


def test_resume_redoes_a_unit_whose_part_is_damaged(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q", "z", "y", "x"])
    run = submit(make_job(), steps=STEPS).run
    before = {path.name: path.read_bytes() for path in Path(run, "results").iterdir()}
    part = sorted(Path(run, "answers").iterdir())[0]
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 4
    part.write_bytes(bytes(data))
    with pytest.raises(InputError, match="sha256"):
        read_table(run, "answers")
    assert resume(run, steps=STEPS).driven.complete
    assert {path.name: path.read_bytes() for path in Path(run, "results").iterdir()} == before


def test_resume_redoes_a_unit_whose_manifest_is_missing(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q", "z", "y", "x"])
    run = submit(make_job(), steps=STEPS).run
    Path(manifest_uri(run, committed_units(run)[0])).unlink()
    assert len(read_table(run, "answers")) in (1, 3), "a part without a manifest does not count"
    resume(run, steps=STEPS)
    assert len(read_table(run, "answers")) == 4


def test_resume_refuses_a_scene_that_changed(make_scene: MakeScene, make_job: MakeJob) -> None:
    scene = make_scene("a", ["q", "z"])
    run = submit(make_job(), steps=STEPS).run
    (scene / "gaussians.ply").write_bytes(b"other splats")
    assert resume(run, steps=NO_STEPS).driven.complete, "nothing is left to do with it"
    Path(manifest_uri(run, committed_units(run)[0])).unlink()
    with pytest.raises(InputError, match="the scene as the run was planned with"):
        resume(run, steps=STEPS)


@pytest.mark.parametrize(
    ("field", "change"),
    [("prompts", {"evidence": "0" * 64}), ("stages", {"perturb": 99}), ("method", {"novel_views": {"count": 8}})],
)
def test_resume_refuses_other_prompts_code_or_config(
    make_scene: MakeScene, make_job: MakeJob, field: str, change: dict[str, Any]
) -> None:
    make_scene("a", ["q"])
    run = submit(make_job(), steps=STEPS).run
    content = RunFolder(run).read_run()
    content["basis"][field].update(change)
    RunFolder(run).write_run(content)
    with pytest.raises(InputError, match="the prompts, models and code the run was planned with") as refused:
        resume(run, steps=STEPS)
    assert notes(refused.value)[0].startswith(f"  {field}.")
    assert " then, " in notes(refused.value)[0]


def test_moved_run_folder_resumes_where_it_is(make_scene: MakeScene, make_job: MakeJob, tmp_path: Path) -> None:
    make_scene("a", ["q", "z", "y", "x"])
    run = submit(make_job(), steps=STEPS).run
    moved = tmp_path / "elsewhere"
    shutil.move(run, moved)
    Path(manifest_uri(str(moved), committed_units(str(moved))[0])).unlink()
    assert resume(moved, steps=STEPS).driven.complete
    assert not Path(run).exists()


def test_bad_job_is_refused_before_anything_runs(make_scene: MakeScene, make_job: MakeJob, tmp_path: Path) -> None:
    scene = make_scene("a", ["q"])
    (scene / "questions.jsonl").write_text("")
    with pytest.raises(InputError, match="at least one question"):
        submit(make_job(), steps=NO_STEPS)
    assert not (tmp_path / "run").exists()


def test_stop_error_leaves_a_run_that_resumes(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q", "z", "y", "stop here"])
    job = make_job(workers={"questions_in_flight": 1})
    with pytest.raises(StopError):
        submit(job, steps=STEPS)
    assert len(read_table(job.output, "answers")) == 3
    mended = dataclasses.replace(STEPS, find_evidence=_calm_evidence)
    assert resume(job.output, steps=mended).driven.complete


async def _calm_evidence(question: Any, vocabulary: Any, caller: Any, method: Any) -> str:
    return "chair"


def test_rows_that_answer_another_question_are_a_bug_that_is_not_committed(
    make_scene: MakeScene, make_job: MakeJob
) -> None:
    def swapped(rows: Any) -> Tables:
        other = unit(0, ["q"], "other").questions[0]
        return {
            **rows,
            "answers": tuple(dataclasses.replace(r, question_id=other.question_id) for r in rows["answers"]),
        }

    make_scene("a", ["q"])
    job = make_job()
    with pytest.raises(AssertionError, match="must have one row"):
        submit(job, steps=dataclasses.replace(STEPS, tables=swapped))
    assert committed_units(job.output) == ()


def test_results_do_not_depend_on_the_chunk_size(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q", "z", "y", "x", "no evidence"])
    runs = [submit(make_job(f"run{n}", workers={"chunk": n}), steps=STEPS).run for n in (1, 2, 5)]
    found = [{p.name: p.read_bytes() for p in Path(run, "results").iterdir()} for run in runs]
    assert found[0] == found[1] == found[2]
    assert write_results(runs[0]) == {"answers": 5, "arms": 12}


def test_job_config_survives_its_own_json(make_scene: MakeScene, make_job: MakeJob) -> None:
    make_scene("a", ["q"])
    job = make_job(calls="/somewhere", tasks=["eqa"])
    assert JobConfig.model_validate_json(job.model_dump_json()) == job
