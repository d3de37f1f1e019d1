"""Baselines in job files: fields checked by kind, rows under the kind's name, nothing built that is not read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jobs.config import JobConfig, checked_job, load_job
from jobs.forecast import forecast
from jobs.runs.plan import plan_units
from jobs.runs.submit import submit
from pipeline.config import MethodConfig
from pipeline.scene.save import save_scene
from pipeline.scene.text_embeddings import TextEmbeddings, text_embeddings_npz
from schemas.errors import InputError
from schemas.question_file import save_questions
from schemas.questions import Question
from schemas.run_folder import read_table
from schemas.semantics_table import SemanticsTable, write_semantics
from tests.query.tiny import tiny_scene

KINDS = (
    *("splatreasoner", "blind", "frame_captions", "scene_graph_captions", "voxel_captions", "multi_frame"),
    *("memory_snapshots", "category_field", "sentence_field", "scores_field"),
)
GOOD = "name: t\noutput: run\nscenes: here\n"


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_a_method_of_a_job(kind: str) -> None:
    method = {"kind": kind, **({"file": "x.npz"} if kind == "scores_field" else {})}
    job = checked_job({"name": "t", "output": "run", "scenes": "here", "method": method}, "job.yaml")
    assert job.method.kind == kind
    assert JobConfig.model_validate_json(job.model_dump_json()) == job


def test_a_method_without_a_kind_is_the_papers() -> None:
    for method in ({}, {"novel_views": {"count": 2}}):
        job = checked_job({"name": "t", "output": "run", "scenes": "here", "method": method}, "job.yaml")
        assert isinstance(job.method, MethodConfig)


@pytest.mark.parametrize(
    ("method", "message"),
    [
        ("{kind: blnd}", "method.kind: expected one of splatreasoner, blind, .*scores_field, found blnd$"),
        ("{kind: blind, frames: 3}", "method: expected one of mark, kind, found frames$"),
        ("{kind: multi_frame, frames: 0}", "method.frames: expected greater than or equal to 1, found 0$"),
        ("{kind: scores_field}", r"method.file: expected a value \(.+\), found nothing$"),
        (
            "{kind: memory_snapshots, objects: {clusters: 1}}",
            "method.objects: expected one of .*, found clusters;",
        ),
        ("{kind: sentence_field, by: labels}", "method.by: expected 'relevancy' or 'cosine', found 'labels'$"),
        ("{novel_views: {cuont: 8}}", "method.novel_views: expected one of .*count.*, found cuont; count is meant"),
        ("blind", "method: expected .*, found 'blind'$"),
    ],
)
def test_a_wrong_field_of_a_kind_is_refused_and_named(tmp_path: Path, method: str, message: str) -> None:
    (tmp_path / "job.yaml").write_text(f"{GOOD}method: {method}\n")
    with pytest.raises(InputError, match=message):
        load_job(tmp_path / "job.yaml")


def test_files_of_a_method_are_relative_to_the_job_file(tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_text(GOOD + 'method: {kind: scores_field, file: "f/{scene}.npz", texts: t.npz}\n')
    method = load_job(tmp_path / "job.yaml").method
    assert (method.file, method.texts) == (str(tmp_path / "f/{scene}.npz"), str(tmp_path / "t.npz"))


def _job(tmp_path: Path, method: dict[str, object]) -> JobConfig:
    folder = tmp_path / "scenes" / "tiny"
    if not folder.exists():
        save_scene(tiny_scene(), str(folder))
        questions = [
            Question("q0", "tiny", "eqa", "What is there?", answer="A chair"),
            Question("q1", "tiny", "ground_one", "the table", target_ids=(2,)),
        ]
        save_questions(questions, folder / "questions.jsonl")
    values = {"name": "t", "output": str(tmp_path / str(method["kind"])), "scenes": str(folder), "method": method}
    return JobConfig.model_validate({**values, "workers": {"in_process": True}})


def test_a_job_of_a_baseline_writes_its_rows_and_no_index(tmp_path: Path) -> None:
    job = _job(tmp_path, {"kind": "blind"})
    run = submit(job).run
    answers = read_table(run, "answers").sort_values("question_id")
    assert answers["method"].tolist() == ["blind", "blind"]
    assert answers["status"].tolist() == ["answered", "skipped"]
    assert read_table(run, "arms")["arm"].tolist() == ["final", "final"]
    assert not list(Path(run).rglob("visibility/**/*.parquet"))
    assert {unit.method for unit in plan_units(job)} == {"blind"}


def test_a_question_that_fails_has_rows_of_its_kind(tmp_path: Path) -> None:
    np.savez(tmp_path / "scores.npz", scores=np.zeros((1, len(tiny_scene().gaussians)), np.float32), names=["other"])
    run = submit(_job(tmp_path, {"kind": "scores_field", "file": str(tmp_path / "scores.npz")})).run
    answers = read_table(run, "answers").set_index("question_id")
    assert answers.loc["q1", "status"] == "failed"
    assert "the id or text of question 'q1'" in answers.loc["q1", "reason"]
    assert answers["method"].unique().tolist() == ["scores_field"]
    assert read_table(run, "arms")["arm"].unique().tolist() == ["final"]


PHRASES = ("object", "things", "stuff", "texture")


def _give(folder: Path, *, size: int | None = None, names: tuple[str, ...] = (), texts: int = 0) -> None:
    """Put embeddings of some size and a text_embeddings.npz into a scene's folder."""
    scene = tiny_scene()
    if size is not None:
        features = np.ones((len(scene.gaussians), size), np.float32)
        write_semantics(SemanticsTable(scene.semantics.vocabulary, None, features), folder / "semantics.parquet")
    if names:
        vectors = TextEmbeddings(names, np.ones((len(names), texts), np.float32))
        (folder / "text_embeddings.npz").write_bytes(text_embeddings_npz(vectors))


@pytest.mark.parametrize(
    ("given", "method", "message"),
    [
        (
            {},
            {},
            r"semantics.parquet: expected column embedding, .* sentence_field .*, found columns category_id,.*_id$",
        ),
        ({"size": 3}, {}, r"text_embeddings.npz: expected the embeddings of .* sentence_field .*, found no such file$"),
        ({"size": 3, "names": PHRASES, "texts": 4}, {}, r"npz: vectors: expected size 3, .*scenes/tiny, found size 4$"),
        (
            {"size": 3, "names": PHRASES[:3], "texts": 3},
            {},
            r"npz: names: expected the canonical .*, found no texture$",
        ),
        ({"size": 3}, {"features": "symbolic"}, r"semantics.parquet: expected column category_id, .*found columns emb"),
        ({}, {"kind": "splatreasoner", "activation": {"by": "cosine"}}, r"column embedding, .* method splatreasoner "),
    ],
)
def test_a_scene_without_what_the_method_searches_is_refused_before_anything_runs(
    tmp_path: Path, given: dict[str, Any], method: dict[str, Any], message: str
) -> None:
    job = _job(tmp_path, {"kind": "sentence_field", **method})
    _give(Path(job.scenes[0]), **given)
    with pytest.raises(InputError, match=message) as refused:
        plan_units(job)
    assert job.scenes[0] in str(refused.value)
    assert not Path(job.output).exists()


def test_a_scene_with_features_is_planned_and_one_without_questions_of_the_method_too(tmp_path: Path) -> None:
    job = _job(tmp_path, {"kind": "sentence_field"})
    eqa = job.model_copy(update={"tasks": ("eqa",)})
    assert list(plan_units(eqa))
    _give(Path(job.scenes[0]), size=3, names=PHRASES, texts=3)
    assert list(plan_units(job))


def test_a_plan_counts_descriptions_once_a_scene(tmp_path: Path) -> None:
    job = _job(tmp_path, {"kind": "frame_captions", "frames": 4})
    questions = [Question(f"q{number}", "tiny", "eqa", f"What is there, {number}?") for number in range(5)]
    save_questions(questions, Path(job.scenes[0], "questions.jsonl"))
    stages = {stage.stage: stage.calls for stage in forecast(job).stages}
    assert stages == {"caption": pytest.approx(4), "answer_text": pytest.approx(5)}


def test_what_a_methods_file_holds_is_part_of_the_units(tmp_path: Path) -> None:
    job = _job(tmp_path, {"kind": "memory_snapshots", "file": str(tmp_path / "{scene}.json")})
    with pytest.raises(InputError, match=r"tiny.json: expected a file that can be read, found No such file"):
        list(plan_units(job))
    found = []
    for content in ('{"view0": ["chair"]}', '{"view1": ["chair"]}', '{"view0": ["chair"]}'):
        (tmp_path / "tiny.json").write_text(content)
        found.append([unit.id for unit in plan_units(job)])
    assert found[0] == found[2] != found[1]


def test_methods_differ_in_the_ids_of_their_units(tmp_path: Path) -> None:
    jobs = [_job(tmp_path, {"kind": kind}) for kind in ("blind", "multi_frame", "splatreasoner")]
    assert len({unit.id for job in jobs for unit in plan_units(job)}) == 3
