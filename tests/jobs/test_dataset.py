"""A benchmark's official files as a job's dataset: its scenes found below roots, the others told."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jobs.config import load_job
from jobs.dataset import load_dataset
from jobs.runs.plan import plan_units
from schemas.errors import InputError
from tests.jobs.conftest import MakeJob

MakeScene = Callable[..., Path]
FIRST, SECOND = "002-scannet-scene0709_00", "003-scannet-scene0762_00"


def item(question_id: str, scene: str) -> dict[str, Any]:
    return {
        "question": f"What is {question_id}?",
        "answer": "A lamp",
        "category": "object recognition",
        "question_id": question_id,
        "episode_history": f"scannet-v0/{scene}",
    }


@pytest.fixture
def official(tmp_path: Path) -> str:
    """An OpenEQA file with two questions about the first scene and one about the second."""
    items = [item("a", FIRST), item("b", SECOND), item("c", FIRST)]
    (tmp_path / "open-eqa-v0.json").write_text(json.dumps(items))
    return str(tmp_path / "open-eqa-v0.json")


@pytest.fixture
def make_benchmark(official: str, make_job: MakeJob, tmp_path: Path) -> MakeJob:
    def make(**changes: Any) -> Any:
        dataset = {"kind": "openeqa", "path": official, "roots": [str(tmp_path / "scenes")]}
        return make_job(scenes=(), dataset={**dataset, **changes.pop("dataset", {})}, **changes)

    return make


def test_official_questions_meet_scenes_below_the_roots(
    make_scene: MakeScene, make_benchmark: MakeJob, tmp_path: Path
) -> None:
    make_scene(FIRST, ["not asked"])
    make_scene(f"scannet-v0/{SECOND}", ["not asked"])
    units = tuple(plan_units(make_benchmark()))
    assert [(u.scene, [q.question_id for q in u.questions]) for u in units] == [(FIRST, ["a", "c"]), (SECOND, ["b"])]
    assert [u.scene_uri for u in units] == [
        str(tmp_path / "scenes" / FIRST),
        str(tmp_path / "scenes" / "scannet-v0" / SECOND),
    ]


def test_scene_that_is_missing_is_refused_with_what_to_download(make_scene: MakeScene, make_benchmark: MakeJob) -> None:
    make_scene(FIRST, ["not asked"])
    message = f"scene {SECOND}: expected a scene at .*{SECOND}, found nothing, for questions: 1; .*scan-net.org"
    with pytest.raises(InputError, match=message):
        load_dataset(make_benchmark())


def test_scene_that_is_missing_is_left_out_and_told_when_asked_so(
    make_scene: MakeScene, make_benchmark: MakeJob
) -> None:
    make_scene(FIRST, ["not asked"])
    told: list[str] = []
    units = tuple(plan_units(make_benchmark(dataset={"missing": "skip"}), warn=told.append))
    assert [q.question_id for u in units for q in u.questions] == ["a", "c"]
    assert len(told) == 1
    assert SECOND in told[0]


def test_capture_that_is_no_scene_yet_is_refused_unless_a_later_root_has_the_scene(
    make_scene: MakeScene, make_benchmark: MakeJob, tmp_path: Path
) -> None:
    make_scene(FIRST, ["not asked"])
    built = make_scene(SECOND, ["not asked"])
    frames = tmp_path / "frames" / "scannet-v0" / SECOND
    frames.mkdir(parents=True)
    (frames / "00000-rgb.png").write_bytes(b"")
    roots = [str(tmp_path / "frames"), str(tmp_path / "scenes")]
    assert {u.scene for u in plan_units(make_benchmark(dataset={"roots": roots}))} == {FIRST, SECOND}
    shutil.rmtree(built)
    with pytest.raises(InputError, match=f"{SECOND}: gaussians: expected one splat file"):
        load_dataset(make_benchmark(dataset={"roots": roots}))


def test_job_file_has_dataset_paths_relative_to_itself(make_scene: MakeScene, official: str, tmp_path: Path) -> None:
    make_scene(FIRST, ["x"])
    (tmp_path / "job.yaml").write_text(
        f"name: n\noutput: run\ndataset: {{kind: openeqa, path: {Path(official).name}, roots: [scenes]}}\n"
    )
    dataset = load_job(tmp_path / "job.yaml").dataset
    assert dataset is not None
    assert (dataset.path, dataset.roots) == (official, (str(tmp_path / "scenes"),))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scenes": "scenes/*"}, "no scenes and questions beside a dataset"),
        ({"scenes": (), "questions": "q.jsonl"}, "no scenes and questions beside a dataset"),
        ({"scenes": (), "dataset": None}, "scenes or a dataset to be given"),
    ],
)
def test_two_sources_of_questions_or_none_are_refused(
    make_job: MakeJob, official: str, changes: dict[str, Any], message: str
) -> None:
    dataset = {"kind": "openeqa", "path": official, "roots": ["scenes"]}
    with pytest.raises(ValueError, match=message):
        make_job(**{"dataset": dataset, **changes})
