from __future__ import annotations

import io
import json
import resource
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
import yaml

from jobs.cli import VERBS, main
from jobs.config import JobConfig
from jobs.runs.submit import submit
from tests.conftest import ROOT
from tests.jobs.conftest import MakeJob
from tests.workers.fake_steps import STEPS

HELP_S = 0.4
"""CPU seconds: the promise is instant help, and imports of numba or Ray would cost more. A busy machine costs none."""


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The command line in this process: what it imports is imported once for all."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(ROOT)
        patch.setattr(sys, "argv", ["splatreasoner", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
    return subprocess.CompletedProcess(arguments, int(ended.value.code or 0), out.getvalue(), err.getvalue())


def run_alone(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The command line as a person starts it."""
    code = "import sys; from jobs.cli import main; sys.argv[0] = 'splatreasoner'; main()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


def one_line(text: str) -> str:
    (line,) = text.strip().splitlines()
    return line


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_every_verb_shows_an_example(verb: str) -> None:
    found = run(verb, "--help")
    assert found.returncode == 0, found.stderr
    assert "Example" in found.stdout
    assert f"splatreasoner {verb}" in found.stdout


def test_help_is_instant_and_names_every_verb() -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = run_alone("--help")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < HELP_S
    assert all(verb in found.stdout for verb in VERBS)


@pytest.mark.parametrize("arguments", [(), ("nonsense",), ("submit",), ("render", "x"), ("demo", "--scenes", "0")])
def test_wrong_usage_exits_2(arguments: tuple[str, ...]) -> None:
    assert run(*arguments).returncode == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("submit", "none.yaml"), "error: none.yaml: expected a file that can be read, found nothing there"),
        (("resume", "none"), "error: none: expected a run folder with run.json, found none"),
        (("status", "none"), "error: none: expected a run folder with run.json, found none"),
        (("aggregate", "none"), "error: none: expected a run folder with run.json, found none"),
        (("report", "none"), "error: none: expected a run folder with run.json, found none"),
        (("render", "none", "--output", "x"), "error: none: expected a scene folder, found nothing there"),
        (
            ("build", "--output", "x"),
            "error: build: expected one of --capture, --job, --scannet-mesh, --procedural, found",
        ),
    ],
)
def test_bad_input_is_one_line_without_a_traceback_and_exits_2(arguments: tuple[str, ...], message: str) -> None:
    found = run(*arguments)
    assert found.returncode == 2
    assert one_line(found.stderr).startswith(message)


def test_codes_and_lines_are_those_of_a_process(tmp_path: Path) -> None:
    for arguments in (("submit", "none.yaml"), ("check", str(tmp_path))):
        here, alone = run(*arguments), run_alone(*arguments)
        assert (here.returncode, here.stdout, here.stderr) == (alone.returncode, alone.stdout, alone.stderr)
        assert here.returncode == 2


def test_check_exits_2_when_a_scene_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "gaussians.ply").write_bytes(b"ply\n")
    found = run("check", tmp_path)
    assert found.returncode == 2
    assert "NOT USABLE" in found.stdout
    assert found.stderr == ""


def test_job_file_errors_name_file_and_field_and_exit_2(tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_text("name: x\noutput: run\nscenes: none\nlimit: 0\nfoo: 1\n")
    found = run("submit", tmp_path / "job.yaml")
    assert found.returncode == 2
    first, second = found.stderr.strip().splitlines()
    assert "job.yaml: limit: expected greater than or equal to 1, found 0" in first
    assert "job.yaml: top level: expected one of name, " in second


@pytest.fixture
def finished(make_scene: Callable[..., Path], make_job: MakeJob) -> JobConfig:
    """A run of fake steps with one failed question."""
    make_scene("a", ["q", "no evidence", "z", "y"])
    job = make_job()
    submit(job, steps=STEPS)
    return job


def test_submit_and_resume_of_a_finished_run_exit_0(finished: JobConfig, tmp_path: Path) -> None:
    file = tmp_path / "job.yaml"
    file.write_text(yaml.safe_dump(finished.model_dump(mode="json", exclude={"method", "models"})))
    for arguments in (("submit", file), ("resume", finished.output)):
        found = run(*arguments)
        assert found.returncode == 0, found.stderr
        assert "4 of 4 questions committed (3 answered, 1 failed)" in found.stdout


def test_status_tells_how_far_a_run_is(finished: JobConfig) -> None:
    found = run("status", finished.output)
    assert found.returncode == 0
    assert found.stdout.splitlines()[:5] == [
        "test: complete",
        "units: 2 of 2 committed",
        "questions: 4 of 4 committed",
        "  answered: 3",
        "  failed: 1",
    ]
    assert "  1 failed: QuestionError: nothing in this scene is named" in found.stdout


def test_aggregate_prints_scores_and_writes_the_final_tables(finished: JobConfig) -> None:
    for file in Path(finished.output, "results").iterdir():
        file.unlink()
    found = run("aggregate", finished.output)
    assert found.returncode == 0, found.stderr
    assert "LLM-Match" in found.stdout
    assert {p.name for p in Path(finished.output, "results").iterdir()} == {"answers.parquet", "arms.parquet"}
    assert "answers.parquet: 4 rows" in found.stdout


def test_report_writes_a_page(finished: JobConfig) -> None:
    found = run("report", finished.output)
    assert found.returncode == 0, found.stderr
    assert Path(one_line(found.stdout)).read_text().startswith("<!doctype html>".upper()[:2])


def test_aggregate_by_prints_one_table_in_the_format_asked_for(finished: JobConfig) -> None:
    found = run("aggregate", finished.output, "--by", "scene")
    assert found.returncode == 0, found.stderr
    header, first, *_ = found.stdout.splitlines()
    assert header.split() == [
        *("method", "task", "scene", "arm", "metric", "mean", "low", "high", "scored", "questions"),
        *("answered", "unparsed", "failed", "skipped", "pending"),
    ]
    assert first.split()[-7:] == ["3", "4", "3", "0", "1", "0", "0"]
    assert run("aggregate", finished.output, "--csv").stdout.startswith("method,task,arm,metric,mean,")
    assert json.loads(run("aggregate", finished.output, "--json").stdout)["planned"] == 4
    assert r"\begin{tabular}" in run("aggregate", finished.output, "--latex").stdout


def test_retry_makes_questions_pending_and_status_and_aggregate_say_so(finished: JobConfig) -> None:
    found = run("retry", finished.output, "--error", "QuestionError")
    assert found.returncode == 0, found.stderr
    assert "1 questions are pending again, in 1 units" in found.stdout
    assert json.loads(run("status", finished.output, "--json").stdout)["questions_done"] == 1
    for arguments in ((), ("--by", "task")):
        told = run("aggregate", finished.output, *arguments)
        assert told.stdout.startswith("INCOMPLETE: 1 of 4 questions are committed"), told.stderr
    piped = run("aggregate", finished.output, "--csv")
    assert piped.stdout.startswith("method,")
    assert piped.stderr.startswith("INCOMPLETE")
    nothing = run("retry", finished.output, "--status", "unparsed")
    assert (nothing.returncode, "nothing to do again" in nothing.stdout) == (0, True)


def test_compare_prints_scores_and_changed_questions(finished: JobConfig) -> None:
    found = run("compare", finished.output, finished.output, "--arm", "initial:final", "--questions")
    assert found.returncode == 0, found.stderr
    assert "initial of A, final of B" in found.stdout
    assert "configuration: no difference" in found.stdout
    assert "0 of 4 answers, scores or statuses changed" in found.stdout
    assert json.loads(run("compare", finished.output, finished.output, "--json").stdout)["warnings"] == []


def test_export_says_what_has_no_answer(finished: JobConfig, tmp_path: Path) -> None:
    found = run("export", finished.output, "--output", tmp_path / "r.json")
    assert found.returncode == 0, found.stderr
    assert "3 of 4 questions answered" in found.stdout
    assert "which OpenEQA's tool scores 0" in found.stdout
    assert json.loads((tmp_path / "r.json").read_text())[1]["answer"] is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("compare", "none", "other"), "error: none: expected a run folder with "),
        (("export", "none", "--output", "x"), "error: none: expected a run folder with run.json, found none"),
        (("retry", "none", "--status", "failed"), "error: none: expected a run folder with run.json, found none"),
        (("retry", "none"), "error: none: expected an error or a status to retry"),
        (("aggregate", "none", "--by", "task"), "error: none: expected a run folder with "),
        (("aggregate", "none", "--csv", "--json"), "error: aggregate: expected one of --csv, --json and --latex"),
    ],
)
def test_result_verbs_refuse_bad_input_in_one_line(arguments: tuple[str, ...], message: str) -> None:
    found = run(*arguments)
    assert found.returncode == 2
    assert one_line(found.stderr).startswith(message)
