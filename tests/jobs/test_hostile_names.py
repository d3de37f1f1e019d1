"""Names from a stranger's files reach no path as they are, and nothing that is read can run code."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from jobs.runs.submit import submit
from jobs.runs.verify import verify_run
from schemas.question_file import save_questions
from schemas.questions import Question
from schemas.run_folder import read_table
from tests.conftest import ROOT
from tests.jobs.conftest import MakeJob
from tests.workers.fake_steps import STEPS

HOSTILE = (
    "../../x",
    "a/b",
    "/etc/x",
    "..",
    ".",
    "CON",
    "x" * 300,
    "é\u202e猫",
    "a\\b",
    "a\nb",
    "~root",
    "$HOME",
    "-rf",
)

SOURCES = [path for package in ("schemas", "pipeline", "workers", "jobs") for path in (ROOT / package).rglob("*.py")]
RUNS_CODE = {"pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve", "joblib", "jsonpickle", "runpy", "code"}
OWN_OBJECTS = {Path("workers/together.py"), Path("pipeline/construct/semantics/language_checkpoint.py")}
"""Where pickle sees nothing but objects this process has just made, and where its error alone is named."""


@pytest.mark.parametrize("scene", ["flat", "../../evil", "CON", "x" * 300, "é/猫"])
def test_questions_and_scenes_of_any_name_stay_inside_the_run(
    make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, scene: str
) -> None:
    folder = make_scene("flat", ["a"])
    (folder / "scene.json").write_text(json.dumps({"name": scene}))
    questions = [Question(name, scene, "eqa", "what is it?", answer="yes") for name in HOSTILE]
    save_questions(questions, folder / "questions.jsonl")
    before = {path for path in tmp_path.rglob("*") if path.is_file()}
    run = Path(submit(make_job(), steps=STEPS).run)
    assert list(read_table(run, "answers")["question_id"]) == list(HOSTILE)
    assert verify_run(run).problems == []
    made = {path for path in tmp_path.rglob("*") if path.is_file()} - before
    assert made
    assert all(path.is_relative_to(run) for path in made)
    assert not list(tmp_path.parent.glob("x*")) + list(tmp_path.parent.glob("evil*"))


def test_null_character_in_an_id_ends_in_a_row_or_an_input_error(
    make_scene: Callable[..., Path], make_job: MakeJob
) -> None:
    folder = make_scene("flat", ["a"])
    save_questions([Question("a\0b", "flat", "eqa", "what\0?", answer="\0")], folder / "questions.jsonl")
    run = submit(make_job(), steps=STEPS).run
    assert list(read_table(run, "answers")["question_id"]) == ["a\0b"]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_nothing_that_is_read_can_run_code(path: Path) -> None:
    place = path.relative_to(ROOT)
    for node in ast.walk(ast.parse(path.read_text())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert place in OWN_OBJECTS or not RUNS_CODE & {name.split(".")[0] for name in names}, f"line {node}"
        if not isinstance(node, ast.Call):
            continue
        called, given = ast.unparse(node.func), {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
        assert called not in ("eval", "exec", "compile", "os.system", "yaml.unsafe_load", "yaml.full_load"), called
        if called in ("np.load", "numpy.load"):
            assert given.get("allow_pickle") == "False", f"line {node.lineno}"
        if called == "torch.load":
            assert given.get("weights_only") == "True", f"line {node.lineno}"
        if called == "yaml.load":
            assert ast.unparse(node.args[1]) == "_UniqueKeys", f"line {node.lineno}"
        if called.startswith("subprocess."):
            assert "shell" not in given, f"line {node.lineno}"


def test_loader_of_job_files_is_a_safe_one() -> None:
    import yaml

    from jobs.yaml_file import _UniqueKeys

    assert issubclass(_UniqueKeys, yaml.SafeLoader)
