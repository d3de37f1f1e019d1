"""The real method on a small generated apartment, through the whole job."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from jobs.config import JobConfig
from jobs.demo import SEEDS, run_demo
from jobs.runs.progress import Silent
from jobs.runs.results import RESULTS
from jobs.runs.submit import resume, submit
from pipeline.scene.check import check_scene
from schemas.manifest import committed_units, manifest_uri
from schemas.question_file import load_questions
from schemas.run_folder import image_name, read_table
from schemas.tables import TABLES


def job(scene: str, output: Path, **workers: Any) -> JobConfig:
    values = {"name": "small", "output": str(output), "scenes": scene}
    return JobConfig.model_validate({**values, "workers": {"in_process": True, "chunk": 3, **workers}})


@pytest.fixture(scope="module")
def finished(apartment: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    return submit(job(apartment, tmp_path_factory.mktemp("runs") / "whole")).run


def result_bytes(run: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(Path(run, RESULTS).iterdir())}


def test_built_apartment_passes_the_check(apartment: str) -> None:
    report = check_scene(apartment)
    assert report.usable, report.errors
    assert report.views == 20
    assert report.objects > 10


def test_every_question_has_its_rows_in_every_table(apartment: str, finished: str) -> None:
    asked = [q.question_id for q in load_questions(Path(apartment, "questions.jsonl"))]
    tables = {name: read_table(finished, name) for name in TABLES}
    assert list(tables["answers"]["question_id"]) == asked
    assert {"eqa", "ground_one", "ground_many"} == set(tables["answers"]["task"])
    assert not (tables["answers"]["status"] == "failed").any(), tables["answers"]["reason"].tolist()
    assert list(tables["arms"].groupby("question_id", sort=False)["arm"].agg(list)) == [
        ["initial", "final", "verified"]
    ] * len(asked)
    for name in ("clusters", "candidates", "calls", "timings"):
        assert len(tables[name]), name
        assert set(tables[name]["question_id"]) <= {*asked, ""}
    stages = set(tables["timings"]["stage"])
    assert stages >= {"load", "index", "evidence", "activate", "cluster", "visibility", "perturb", "render", "ground"}


def test_keys_are_unique_in_every_table(finished: str) -> None:
    for name, spec in TABLES.items():
        frame = read_table(finished, name)
        if name != "timings":  # work done once a scene may stand there more than once, under an empty question
            assert not frame.duplicated(list(spec.key)).any(), name


def test_every_candidate_has_its_thumbnail(finished: str) -> None:
    candidates = read_table(finished, "candidates")
    names = {image_name(row.scene, row.candidate, row.world_to_camera) for row in candidates.itertuples()}
    assert names == {path.relative_to(finished).as_posix() for path in Path(finished, "images").rglob("*.jpg")}


def test_redone_units_give_the_same_bytes(finished: str) -> None:
    before = result_bytes(finished)
    for unit in committed_units(finished)[::2]:
        Path(manifest_uri(finished, unit)).unlink()
    assert resume(finished).driven.complete
    assert result_bytes(finished) == before


@pytest.mark.slow
def test_ray_gives_the_bytes_of_the_in_process_run(apartment: str, finished: str, tmp_path: Path) -> None:
    spread = submit(job(apartment, tmp_path / "ray", in_process=False, cpus=2))
    assert result_bytes(spread.run) == result_bytes(finished)


@pytest.mark.slow
def test_demo_runs_whole_and_again_reuses_all(tmp_path: Path) -> None:
    first = run_demo(tmp_path, scenes=1, progress=Silent())
    assert first.driven.complete
    assert first.driven.planned >= 100
    scene = tmp_path / "scenes" / f"apartment-{SEEDS[0]}" / "gaussians.ply"
    before, results = scene.stat().st_mtime_ns, result_bytes(first.run)
    again = run_demo(tmp_path, scenes=1, progress=Silent())
    assert scene.stat().st_mtime_ns == before
    assert result_bytes(again.run) == results
    assert (read_table(first.run, "answers")["model"] == "symbolic").mean() > 0.9
