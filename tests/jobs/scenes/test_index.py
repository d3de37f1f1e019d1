"""The visibility index of a job: rendered once, whatever is asked later, by whom and after which crash."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jobs.config import JobConfig, load_job
from jobs.runs.submit import resume, submit
from jobs.scenes.index import build_index
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex
from pipeline.query.visibility_store import VisibilityStore
from pipeline.render import prepare
from pipeline.scene.load import load_scene
from pipeline.scene.save import save_scene
from schemas.errors import InputError
from schemas.manifest import committed_units, manifest_uri
from schemas.question_file import save_questions
from schemas.questions import Question
from schemas.run_folder import read_table
from tests.conftest import ROOT
from tests.jobs.test_cli import run as command_line
from tests.query.tiny import tiny_scene

CONFIG = VisibilityConfig()


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    folder = tmp_path / "scenes" / "tiny"
    save_scene(tiny_scene(), str(folder))
    ask(folder, "What color is the chair?", "Where is the table?", "Is there a zebra?")
    return folder


def ask(scene: Path, *texts: str) -> None:
    questions = [Question(f"tiny-{i}", "tiny", "eqa", text, answer="red") for i, text in enumerate(texts)]
    save_questions(questions, scene / "questions.jsonl")


def job(scene: Path, run: str, visibility: Path | None = None, **changes: Any) -> JobConfig:
    workers = {"chunk": 2, "cpus": 2, "in_process": True, **changes.pop("workers", {})}
    values = {"name": run, "output": str(scene.parents[1] / run), "scenes": str(scene), "workers": workers}
    return JobConfig.model_validate(values | {"visibility": visibility and str(visibility)} | changes)


def counts(run: str, stage: str) -> int:
    table = read_table(run, "timings")
    return int(table.loc[table["stage"] == stage, "count"].sum())


BUILD_ALL = {"visibility": {"build": "all"}}


def test_second_run_and_new_question_render_nothing_and_answer_the_same(scene: Path, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    first = submit(job(scene, "first", shared, method=BUILD_ALL)).run
    assert (counts(first, "index_read"), counts(first, "index")) == (0, 6)
    second = submit(job(scene, "second", shared, method=BUILD_ALL)).run
    assert (counts(second, "index_read"), counts(second, "index")) == (6, 0)
    for name in ("answers.parquet", "arms.parquet"):
        assert Path(first, "results", name).read_bytes() == Path(second, "results", name).read_bytes()
    ask(scene, "What color is the table?", "How many chairs are there?")
    third = submit(job(scene, "third", shared, method=BUILD_ALL)).run
    assert (counts(third, "index_read"), counts(third, "index")) == (6, 0)


def test_resumed_run_reads_the_rows_it_rendered_before(scene: Path) -> None:
    run = submit(job(scene, "run", method=BUILD_ALL)).run
    for unit in committed_units(run):
        Path(manifest_uri(run, unit)).unlink()
    assert resume(run).driven.complete
    assert (counts(run, "index_read"), counts(run, "index")) == (6, 0)


@pytest.mark.slow
def test_run_on_ray_reads_what_a_run_in_one_process_stored(scene: Path, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    submit(job(scene, "here", shared, method=BUILD_ALL))
    part = next(iter(shared.rglob("*.arrow")))
    part.write_bytes(part.read_bytes()[:-1])
    there = submit(job(scene, "there", shared, workers={"in_process": False})).run
    assert counts(there, "index_read") + counts(there, "index") == 6
    assert counts(there, "index") > 0
    again = submit(job(scene, "again", shared, workers={"in_process": False})).run
    assert (counts(again, "index_read"), counts(again, "index")) == (6, 0)
    assert "damaged" in Path(there, "events.jsonl").read_text()


def test_index_lies_in_the_run_unless_the_job_names_a_folder(scene: Path, tmp_path: Path) -> None:
    assert job(scene, "run").visibility_folder() == str(tmp_path / "run" / "visibility")
    file = tmp_path / "jobs" / "job.yaml"
    file.parent.mkdir()
    for given, found in (("../v", str(tmp_path / "v")), ("s3://bucket/v", "s3://bucket/v")):
        file.write_text(f"name: t\noutput: run\nscenes: x\nvisibility: {given}\n")
        assert load_job(file).visibility_folder() == found


def test_scene_whose_gaussians_changed_finds_no_stale_row(scene: Path, tmp_path: Path) -> None:
    shared = str(tmp_path / "shared")
    assert build_index(str(scene), shared, CONFIG).rendered == 6
    moved = tiny_scene()
    means = moved.gaussians.means.copy()
    means[0, 0] += 0.5
    gaussians = type(moved.gaussians)(
        means, moved.gaussians.quats, moved.gaussians.log_scales, moved.gaussians.opacity_logits, moved.gaussians.sh
    )
    other = tmp_path / "scenes" / "moved"
    save_scene(type(moved)("moved", gaussians, moved.views, moved.semantics, moved.up), str(other))
    assert build_index(str(other), shared, CONFIG).rendered == 6
    assert build_index(str(other), shared, VisibilityConfig(near_m=0.25)).rendered == 6
    built = build_index(str(scene), shared, CONFIG, threads=2)
    assert (built.stored, built.rendered, built.views) == (6, 0, 6)


def test_index_verb_says_seconds_and_bytes_and_a_job_then_renders_nothing(scene: Path, tmp_path: Path) -> None:
    told = [command_line("index", scene, "--threads", "2", "--output", tmp_path / "v") for _ in range(2)]
    assert "6 views, 0 were stored, 6 rendered" in told[0].stdout
    assert "s a view" in told[0].stdout
    assert "kB a view" in told[0].stdout
    assert '"items": "views", "done": 6, "total": 6' in told[0].stderr
    assert "6 views, 6 were stored, 0 rendered" in told[1].stdout
    run = submit(job(scene, "run", tmp_path / "v")).run
    assert (counts(run, "index_read"), counts(run, "index")) == (6, 0)


def test_folder_that_cannot_be_written_is_named(scene: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        build_index(str(scene), str(tmp_path / "file"), CONFIG)


STUCK_BUILD = """
import sys, time
import jobs.scenes.index
from jobs.runs.progress import Silent
from pipeline.query.visibility import VisibilityConfig
class Stuck(Silent):
    views = 0
    def advance(self, error):
        self.views += 1
        if self.views == int(sys.argv[3]):
            print("stuck", flush=True)
            time.sleep(60)
jobs.scenes.index.VIEWS_A_PART = 1
jobs.scenes.index.build_index(sys.argv[1], sys.argv[2], VisibilityConfig(), progress=Stuck())
"""


def test_killed_builds_leave_a_store_that_the_next_one_completes(scene: Path, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    builds = [
        subprocess.Popen(
            [sys.executable, "-c", STUCK_BUILD, str(scene), str(shared), views],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        for views in ("1", "4")
    ]
    for build in builds:
        assert build.stdout is not None
        assert build.stdout.readline() == "stuck\n"
        build.kill()
        build.communicate()
    whole = build_index(str(scene), str(shared), CONFIG)
    assert 4 <= whole.stored <= 5, "a build that began later went on where the other was"
    assert whole.views == 6
    loaded = load_scene(str(scene))
    cameras = [view.camera for view in loaded.views]
    index = VisibilityIndex(prepare(loaded.gaussians), cameras, CONFIG)
    found = VisibilityStore.of(str(shared), loaded.gaussians, cameras, CONFIG).read()
    assert found.damaged == ()
    for view in range(6):
        np.testing.assert_array_equal(found.ids[view], index.ids(view))
