"""`splatreasoner table` and `aggregate --table` as a person sees them."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import pytest
import yaml

from jobs.tables.table_file import load_table
from jobs.verbs.aggregate import aggregate
from jobs.verbs.table import table
from schemas.errors import InputError
from tests.jobs.synthetic_run import write_run

CONTENT: dict[str, Any] = {
    "name": "t",
    "caption": "two tasks",
    "base": {"output": "out", "scenes": "scenes"},
    "parts": {"A": {"tasks": ["eqa"]}, "B": {"tasks": ["ground_many"]}},
    "columns": {
        "match": {"label": "LLM-Match", "metric": "llm_match", "part": "A"},
        "many": {"label": "mIoU", "metric": "instance_miou", "part": "B"},
    },
    "rows": {
        "ours": {"label": "ours", "change": {}, "reference": {"match": 57.8}},
        "human": {"label": "Human", "reference": {"match": 86.8}},
    },
}


@pytest.fixture
def file(tmp_path: Path) -> str:
    """A table whose runs are there."""
    path = tmp_path / "table.yaml"
    path.write_text(yaml.safe_dump(CONTENT, sort_keys=False))
    found = load_table(path)
    for run in found.runs():
        write_run(Path(found.place(run)))
    return str(path)


def test_show_prints_a_block_a_part_and_what_there_is_to_know(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    table(file, show=True)
    said = capsys.readouterr().out
    lines = said.splitlines()
    assert lines[0] == "t: two tasks"
    assert [line.split()[-1] for line in lines if line.startswith("Method")] == ["scored", "scored"]
    assert lines.index("A") < lines.index("B")
    assert "57.8" in said
    assert "86.8" in said
    assert "if 0:" in said


@pytest.mark.parametrize("verb", ["table", "aggregate"])
def test_csv_has_a_line_a_cell(file: str, verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    if verb == "table":
        table(file, show=True, as_csv=True)
    else:
        aggregate(load_table(file).output, table=file, as_csv=True)
    rows = [*csv.DictReader(io.StringIO(capsys.readouterr().out))]
    assert [(row["row"], row["part"]) for row in rows] == [("ours", "A"), ("ours", "B"), ("Human", "A"), ("Human", "B")]
    assert float(rows[0]["low"]) < float(rows[0]["ours"]) < float(rows[0]["high"])


def test_latex_is_one_tabular(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    table(file, show=True, as_latex=True)
    said = capsys.readouterr().out
    assert said.startswith("% t: two tasks\n")
    assert r"Method & A: LLM-Match & B: mIoU & scored A & scored B \\" in said
    assert not set("…±–") & set(said)


def test_list_tells_changes_and_folders(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    table(file, list_rows=True)
    said = capsys.readouterr().out
    assert "ours: ours: the base" in said
    assert "human: Human: the paper's figures alone" in said
    assert all(load_table(file).place(run) in said for run in load_table(file).runs())


def test_wrong_options_are_refused(file: str) -> None:
    with pytest.raises(InputError, match="--csv and --latex"):
        table(file, show=True, as_csv=True, as_latex=True)
    with pytest.raises(InputError, match="--table"):
        aggregate("out", table=file, by="scene")
    with pytest.raises(InputError, match="em-eqa"):
        table("em-eqq", show=True)
