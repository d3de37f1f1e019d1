"""Runs over damaged files: scenes and questions of the real method, and what a run has written itself."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from jobs.config import JobConfig
from jobs.runs.submit import in_another_folder, resume, submit
from jobs.runs.verify import verify_run
from pipeline.scene.save import save_scene
from schemas.question_file import load_questions, save_questions
from schemas.questions import Question
from tests.jobs.chaos.measured import Measured, Rows, answers, rows
from tests.jobs.conftest import MakeJob
from tests.query.tiny import tiny_scene
from tests.workers.fake_steps import STEPS

TEXTS = ["What stands beside the chair?", "Is there a table?"]
FAKE_TEXTS = ["a", "no evidence", "b", "cc", "bug", "d", "ee"]


def build(scenes: Path) -> Path:
    """Make three small scenes that the real method can answer questions about."""
    for name in "abc":
        folder = scenes / name
        save_scene(tiny_scene(name), str(folder))
        questions = [Question(f"{name}-{i}", name, "eqa", text, answer="table") for i, text in enumerate(TEXTS)]
        save_questions(
            [*questions, Question(f"{name}-{len(TEXTS)}", name, "ground_one", "the table", target_ids=(2,))],
            folder / "questions.jsonl",
        )
    return scenes


@pytest.fixture
def flats(tmp_path: Path) -> Path:
    return build(tmp_path / "scenes")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    """What the real method says of the scenes."""
    place = tmp_path_factory.mktemp("whole")
    values = {"name": "whole", "output": str(place / "run"), "scenes": str(build(place / "scenes") / "*")}
    return rows(submit(JobConfig.model_validate({**values, "workers": {"in_process": True}})).run)


@pytest.fixture
def fakes(make_scene: Callable[..., Path], tmp_path: Path) -> Path:
    """Two scenes for fake steps."""
    for name in "ab":
        make_scene(name, FAKE_TEXTS)
    return tmp_path / "scenes"


def cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def empty(data: bytes) -> bytes:
    return b""


def zeros(data: bytes) -> bytes:
    return bytes(len(data))


def boastful(data: bytes) -> bytes:
    """The header says that there are a million million splats."""
    lines = data.split(b"\n")
    place = next(number for number, line in enumerate(lines) if line.startswith(b"element vertex"))
    lines[place] = b"element vertex 1000000000000"
    return b"\n".join(lines)


@pytest.mark.chaos("corrupt PLY")
@pytest.mark.parametrize(
    "harm", [cut, *(pytest.param(harm, marks=pytest.mark.slow) for harm in (boastful, empty, zeros))]
)
def test_scene_with_a_corrupt_ply_is_failed_rows_and_the_others_are_answered(
    flats: Path, whole: Rows, make_job: MakeJob, measured: Measured, harm: Callable[[bytes], bytes]
) -> None:
    ply = flats / "b" / "gaussians.ply"
    ply.write_bytes(harm(ply.read_bytes()))
    job = make_job("hurt")
    assert measured.run(lambda: submit(job)) is None
    measured.compare(job.output, whole, failed={name: "InputError: " for name in whole if name.startswith("b-")})
    assert all("gaussians.ply" in row["reason"] for row in answers(job.output) if row["scene"] == "b")


@pytest.mark.chaos("NaN poses")
def test_views_without_a_pose_are_left_out_and_a_scene_without_any_is_refused(
    flats: Path, whole: Rows, make_job: MakeJob, measured: Measured
) -> None:
    path = flats / "b" / "transforms.json"
    cameras = json.loads(path.read_text())
    no_pose = {"transform_matrix": [[float("nan")] * 4] * 4}
    extra = [{**frame, **no_pose, "file_path": f"nan{place}"} for place, frame in enumerate(cameras["frames"])]
    path.write_text(json.dumps({**cameras, "frames": [*cameras["frames"], *extra]}))
    job = make_job("hurt")
    assert measured.run(lambda: submit(job)) is None
    measured.compare(job.output, whole)
    path.write_text(json.dumps({**cameras, "frames": extra}))
    blind = make_job("blind")
    assert "pose" in str(measured.run(lambda: submit(blind)))
    assert not Path(blind.output).exists()
    assert measured.exits == [0, 2]
    measured.note = f"{len(extra)} of {2 * len(extra)} views left out; all of them: refused at plan"


@pytest.mark.chaos("duplicate ids")
@pytest.mark.parametrize("place", ["a", "b"], ids=["in one file", "in two scenes"])
def test_repeated_question_id_is_refused_before_anything_is_written(
    fakes: Path, make_job: MakeJob, measured: Measured, place: str
) -> None:
    file = fakes / place / "questions.jsonl"
    kept = load_questions(file)
    whole = submit(make_job("whole"), steps=STEPS).run
    save_questions([*kept, Question("a-0", place, "eqa", "Once more?")], file)
    job = make_job("hurt")
    assert "a-0" in str(measured.run(lambda: submit(job, steps=STEPS)))
    assert measured.exits == [2]
    assert not Path(job.output).exists()
    save_questions(kept, file)
    assert submit(job, steps=STEPS).driven.complete
    measured.compare(job.output, whole)
    measured.note = "nothing written"


def damaged(path: Path, draw: random.Random) -> None:
    """Truncate a file, flip a bit of it, empty it or remove it."""
    data = bytearray(path.read_bytes())
    kind = draw.choice(("bit", "cut", "empty", "gone"))
    if kind == "gone":
        path.unlink()
        return
    data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    path.write_bytes({"bit": bytes(data), "cut": bytes(data[: len(data) // 2]), "empty": b""}[kind])


@pytest.mark.chaos("damaged Parquet")
@pytest.mark.parametrize("seed", range(4))
def test_damaged_files_of_a_run_are_found_and_their_units_done_again(
    fakes: Path, make_job: MakeJob, measured: Measured, seed: int
) -> None:
    job = make_job("hurt")
    whole = rows(submit(job, steps=STEPS).run)
    draw, run = random.Random(seed), Path(job.output)
    parts = sorted([*run.glob("*/*.parquet"), *run.glob("manifests/*.json")])
    hurt = draw.sample([path for path in parts if path.parent.name != "results"], 5)
    for path in hurt:
        damaged(path, draw)
    assert verify_run(run).problems or not all(path.suffix == ".parquet" for path in hurt)
    assert measured.run(lambda: resume(run, steps=STEPS)) is None
    measured.compare(job.output, whole)
    assert verify_run(run).problems == []
    measured.note = f"{len(hurt)} files"


def take_back(run: str) -> list[Path]:
    """Remove the commit of every second unit; return those that stay."""
    found = sorted(Path(run, "manifests").iterdir())
    for path in found[::2]:
        path.unlink()
    return found[1::2]


@pytest.mark.chaos("folder removed")
@pytest.mark.parametrize("folder", ["driver", "visibility", "calls", "events.jsonl", "manifests"])
def test_folder_removed_from_a_run_costs_work_and_no_row(
    fakes: Path, make_job: MakeJob, measured: Measured, folder: str
) -> None:
    job = make_job("hurt")
    whole = rows(submit(job, steps=STEPS).run)
    take_back(job.output)
    gone = Path(job.output, folder)
    shutil.rmtree(gone, ignore_errors=True) if folder != "events.jsonl" else gone.unlink()
    assert not gone.exists()
    assert measured.run(lambda: resume(job.output, steps=STEPS)) is None
    measured.compare(job.output, whole)
    measured.note = folder


@pytest.mark.chaos("changed config")
def test_other_config_in_a_run_that_has_begun_is_refused_with_the_difference(
    fakes: Path, make_job: MakeJob, measured: Measured
) -> None:
    job = make_job("hurt")
    changed = make_job("hurt", method={"novel_views": {"count": 2}})
    whole = rows(submit(job, steps=STEPS).run)
    left = take_back(job.output)
    error = measured.run(lambda: submit(changed, steps=STEPS))
    assert measured.exits == [2]
    assert "method.novel_views.count: 4 then, 2 now" in "\n".join(getattr(error, "__notes__", []))
    assert sorted(Path(job.output, "manifests").iterdir()) == left, "nothing was done"
    assert submit(in_another_folder(changed, f"{job.output}2"), steps=STEPS).driven.complete
    assert resume(job.output, steps=STEPS).driven.complete
    measured.compare(job.output, whole)
    measured.note = "another folder takes it"
