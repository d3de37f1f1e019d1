"""A forecast says, from some questions, what a run of all is then billed for; nothing is sent for it."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from jobs.config import JobConfig
from jobs.forecast import forecast
from jobs.runs.submit import submit
from jobs.verbs.plan import plan
from schemas.question_file import load_questions, save_questions
from schemas.run_folder import read_table
from tests.jobs.metered_server import METERED_STEPS, MeteredServer, metered_endpoint

SHARE = 0.15
"""What the forecast may be off by."""
REQUESTS_PER_MIN = 100_000
"""More than the server is asked."""


@pytest.fixture
def job(apartment: str, tmp_path: Path, server: MeteredServer) -> JobConfig:
    return JobConfig.model_validate(
        {
            "name": "metered",
            "output": str(tmp_path / "run"),
            "scenes": apartment,
            "models": {"endpoints": {"e": metered_endpoint(server, requests_per_min=REQUESTS_PER_MIN)}, "default": "e"},
            "workers": {"in_process": True},
        }
    )


@pytest.fixture
def server() -> Iterator[MeteredServer]:
    with MeteredServer() as found:
        yield found


def test_forecast_is_within_its_share_of_what_the_server_then_bills(job: JobConfig, server: MeteredServer) -> None:
    questions = load_questions(Path(job.scenes[0], "questions.jsonl"))
    said = forecast(job, sample=len(questions) // 2)
    assert said.sampled < said.questions
    assert server.sent == 0, "nothing is sent for a forecast"
    run = submit(job, steps=METERED_STEPS).run
    bill = [sum(column) for column in zip(*server.priced().values(), strict=True)]
    planned = [[s.calls, s.prompt_tokens, s.completion_tokens, s.usd or 0.0] for s in said.stages]
    assert [sum(column) for column in zip(*planned, strict=True)] == pytest.approx(bill, rel=SHARE)
    shown = read_table(run, "candidates").query("source == 'render'")
    rendered = set(zip(shown["question_id"], map(tuple, shown["world_to_camera"]), strict=True))
    assert said.pictures == pytest.approx(len(rendered), rel=SHARE)
    calls = read_table(run, "calls")
    paid = calls[~calls["cached"]]
    assert [len(paid), paid["prompt_tokens"].sum(), paid["completion_tokens"].sum()] == bill[:3]


QUESTIONS = 2


@pytest.fixture
def bad_job(apartment: str, tmp_path: Path) -> Path:
    """A job over a sound scene, one with a pose that is no number, and one whose splat file is cut."""
    for name in ("sound", "posed", "cut"):
        folder = shutil.copytree(apartment, tmp_path / "scenes" / name)
        (folder / "scene.json").write_text(json.dumps(json.loads((folder / "scene.json").read_text()) | {"name": name}))
        found = load_questions(folder / "questions.jsonl")[:1] * QUESTIONS
        renamed = [dataclasses.replace(q, scene=name, question_id=f"{name}-{n}") for n, q in enumerate(found)]
        save_questions(renamed, folder / "questions.jsonl")
    cameras = tmp_path / "scenes" / "posed" / "transforms.json"
    poses = json.loads(cameras.read_text())
    poses["frames"][0]["transform_matrix"][0][0] = "nan"
    cameras.write_text(json.dumps(poses))
    splats = tmp_path / "scenes" / "cut" / "gaussians.ply"
    splats.write_bytes(splats.read_bytes()[:5000])
    file = tmp_path / "job.yaml"
    file.write_text("name: n\noutput: run\nscenes: scenes/*\nworkers: {in_process: true}\n")
    return file


def test_verb_plan_says_units_renders_calls_and_what_looks_wrong(
    bad_job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan(bad_job, sample=None, seconds_a_call=2.0)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"3 scenes, {3 * QUESTIONS} questions, 3 units; {3 * QUESTIONS} questions tried"
    assert lines[1].startswith("to render: ")
    assert any(line.startswith("evidence    symbolic ") for line in lines)
    posed, repeated, cut = (line for line in lines if line.startswith("note: "))
    assert "posed: skipped 1 of 20 views with an unusable pose" in posed
    assert repeated.startswith("note: 3 questions repeat another of their scene; first: ")
    assert cut.startswith(f"note: {tmp_path / 'scenes' / 'cut'} will fail: ")
    assert not (tmp_path / "run" / "run.json").exists()
