"""Tables of runs: what a file may say, what is run once and shared, and what is printed beside the paper's figures."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd
import pytest
import yaml

from jobs.frame_text import to_csv, to_latex
from jobs.runs.versions import STAGES
from jobs.scoring.aggregate import aggregate
from jobs.tables.table_file import PRESETS, Table, load_table, merged
from jobs.tables.table_run import as_last_run, run_table
from jobs.tables.table_scores import Cell, cell_rows, table_cells
from jobs.tables.table_text import notes, table_frame
from schemas.errors import InputError
from schemas.manifest import committed_units
from tests.jobs.synthetic_run import write_run
from tests.workers.fake_steps import STEPS, answer, arm

CONTENT: dict[str, Any] = {
    "name": "small",
    "caption": "two scores",
    "base": {"tasks": ["eqa"], "workers": {"in_process": True, "chunk": 3}},
    "columns": {
        "match": {"label": "LLM-Match", "metric": "llm_match"},
        "frames": {"label": "Frames", "metric": "frames"},
        "p": {"label": "p", "metric": "llm_match", "value": "p", "against": "volume"},
    },
    "rows": {
        "volume": {
            "label": "Volume score",
            "change": {"method.initial_views.score": "volume"},
            "reference": {"match": 47.8, "frames": 2.7},
        },
        "ours": {"label": "ours", "change": {}, "reference": {"match": 48.2}},
        "initial": {"label": "initial", "run": "ours", "arm": "initial"},
        "human": {"label": "Human", "reference": {"match": 86.8, "frames": "Full"}},
    },
}
TEXTS = ["Where is the cup?", "Is the lamp on?", "What is red?", "How many chairs are there?"]

asked: list[str] = []
"""Questions concluded, over all runs of a test."""


def _conclude(context: Any, question: Any, evidence: Any, proposal: Any, decision: Any, method: Any) -> dict[str, Any]:
    """Marks that depend on the method, on the arm and on the question."""
    asked.append(question.question_id)
    better = method.initial_views.score == "visibility"
    marks = {"initial": 1, "final": 3, "verified": 5 if better and len(question.question) % 2 else 3}
    arms = [arm(question, name, mark=mark, frames=2 + better) for name, mark in marks.items()]
    return {"answers": (answer(question),), "arms": tuple(arms), "candidates": ()}


MARKING = dataclasses.replace(STEPS, conclude=_conclude)

MakeTable = Callable[..., Table]


@pytest.fixture
def make_table(tmp_path: Path, make_scene: Any, make_job: Any) -> MakeTable:
    """Write a table file over two small scenes and load it."""
    make_scene("kitchen", TEXTS)
    make_scene("attic", TEXTS[:2])
    asked.clear()

    def make(content: dict[str, Any] | None = None, **changes: Any) -> Table:
        path = tmp_path / "table.yaml"
        found = merged(content or CONTENT, {"base.scenes": "scenes/*", "base.output": "out"} | changes)
        path.write_text(yaml.safe_dump(found, sort_keys=False))
        return load_table(path)

    return make


def _cell(cells: list[Cell], row: str, column: str) -> Cell:
    (found,) = [cell for cell in cells if (cell.row, cell.column) == (row, column)]
    return found


def test_table_runs_each_source_once_and_shows_its_arms(make_table: MakeTable, tmp_path: Path) -> None:
    table = make_table()
    result = run_table(table, steps=MARKING)
    assert (result.complete, result.wanted, len(asked)) == (True, 2, 2 * 6)
    assert sorted(map(str, (tmp_path / "out" / "runs").iterdir())) == sorted(map(table.place, table.runs()))
    cells = table_cells(table)
    assert _cell(cells, "volume", "match").value == 50
    assert _cell(cells, "initial", "match").value == 0
    odd = sum(len(text) % 2 for text in (*TEXTS, *TEXTS[:2]))
    found = _cell(cells, "ours", "match")
    assert found.value == pytest.approx(50 + 50 * odd / 6)
    assert (found.scored, found.questions, found.scenes, found.pending, found.reference) == (6, 6, 2, 0, 48.2)
    assert found.low is not None
    assert found.high is not None
    assert found.low <= found.value <= found.high
    assert _cell(cells, "ours", "frames").value == 3
    assert _cell(cells, "human", "match").value is None


def test_table_runs_share_stored_replies_and_visibility(make_table: MakeTable, tmp_path: Path) -> None:
    table = make_table()
    jobs = [table.job(run) for run in table.runs()]
    assert {job.calls_folder() for job in jobs} == {str(tmp_path / "out" / "calls")}
    assert {job.visibility_folder() for job in jobs} == {str(tmp_path / "out" / "visibility")}
    assert [job.method.initial_views.score for job in jobs] == ["volume", "visibility"]


def test_table_that_is_done_is_not_run_again(make_table: MakeTable) -> None:
    run_table(make_table(), steps=MARKING)
    before = len(asked)
    assert run_table(make_table(), steps=MARKING).complete
    assert len(asked) == before


def test_table_that_was_stopped_goes_on_where_it_was(make_table: MakeTable) -> None:
    table = make_table()
    assert run_table(table, ("volume",), steps=MARKING).complete
    cells = table_cells(table)
    assert _cell(cells, "volume", "match").value == 50
    assert _cell(cells, "ours", "match").value is None
    assert "Not run: ours, initial." in notes(table, cells)
    run_table(table, steps=MARKING)
    assert len(asked) == 2 * 6
    assert len([*committed_units(table.place(*table.runs(("ours",))))]) == 3


def test_table_rows_that_share_a_run_do_it_for_either(make_table: MakeTable) -> None:
    table = make_table()
    assert [str(run) for run in table.runs(("initial",))] == ["ours"]
    assert [str(run) for run in table.runs(("human",))] == []


def test_rows_that_are_the_same_job_share_one_run_in_whatever_table(make_table: MakeTable) -> None:
    run_table(make_table(), steps=MARKING)
    before = len(asked)
    same = {"label": "the same", "change": {"method": {"initial_views": {"score": "visibility"}}}}
    other = make_table(**{"name": "other", "rows.text": same, "base.workers.chunk": 3, "base.workers.cpus": 1})
    assert run_table(other, steps=MARKING).wanted == 2
    assert len(asked) == before
    assert _cell(table_cells(other), "text", "match").value == _cell(table_cells(other), "ours", "match").value


def test_table_as_it_was_last_run_is_found_again(make_table: MakeTable, tmp_path: Path) -> None:
    make_table()
    path = tmp_path / "table.yaml"
    limited = load_table(path, settings={"limit": 1})
    run_table(limited, steps=MARKING)
    assert _cell(table_cells(load_table(path)), "ours", "match").questions == 0
    again = as_last_run(load_table(path))
    assert again == limited
    assert _cell(table_cells(again), "ours", "match").questions == 2
    nowhere = load_table(path, output=str(tmp_path / "elsewhere"))
    assert as_last_run(nowhere) == nowhere


def test_rows_that_were_changed_get_another_run(make_table: MakeTable) -> None:
    table = make_table()
    for change in (
        {"rows.volume.change": {"method.judging.verify": False}},
        {"base.limit": 1},
        {"base.tasks": ["eqa", "ground_one"]},
    ):
        changed = make_table(**change)
        assert changed.place(*changed.runs(("volume",))) != table.place(*table.runs(("volume",)))


def test_run_that_other_code_made_is_refused_with_what_to_do(
    make_table: MakeTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = make_table()
    run_table(table, ("volume",), steps=MARKING)
    monkeypatch.setitem(STAGES, "scores", 99)
    with pytest.raises(InputError) as raised:
        run_table(table, ("volume",), steps=MARKING)
    assert any("stages.scores" in note for note in raised.value.__notes__)
    assert any(table.place(*table.runs(("volume",))) in note for note in raised.value.__notes__)


class TestRepeats:
    CONTENT = merged(CONTENT, {"rows.ours.repeats": 3, "rows.volume.repeats": 2})

    def test_each_repetition_is_a_run_of_its_own(self, make_table: MakeTable) -> None:
        table = make_table(self.CONTENT)
        assert run_table(table, steps=MARKING).wanted == 5
        assert [str(run) for run in table.runs()] == ["volume", "volume.1", "ours", "ours.1", "ours.2"]
        assert len(asked) == 5 * 6
        cell = _cell(table_cells(table), "ours", "match")
        assert (cell.runs, cell.std, cell.questions) == (3, 0.0, 6)
        assert _cell(table_cells(table), "initial", "match").runs == 3
        assert "± 0.00" in table_frame(table, table_cells(table)).iloc[3, 1]

    def test_endpoints_are_told_the_number_of_the_repetition(self, make_table: MakeTable) -> None:
        endpoint = {"kind": "openai", "base_url": "http://localhost:1/v1", "model": "m", "seed": 7}
        models = {"endpoints": {"vision": endpoint}, "default": "vision"}
        table = make_table(merged(self.CONTENT, {"base.models": models}))
        identities = [table.job(run).models.endpoints["vision"].identity() for run in table.runs(("ours",))]
        assert [identity.get("repeat") for identity in identities] == [None, 1, 2]


class TestParts:
    CONTENT: ClassVar[dict[str, Any]] = {
        **CONTENT,
        "parts": {"kitchen": {"limit": 2}, "all": {}},
        "columns": {
            "few": {"label": "LLM-Match", "metric": "llm_match", "part": "kitchen"},
            "many": {"label": "LLM-Match", "metric": "llm_match", "part": "all", "digits": 2},
        },
        "rows": {"ours": {"label": "ours", "change": {}, "reference": {"few": 1.5}}},
    }

    def test_each_part_is_a_run_and_a_denominator(self, make_table: MakeTable) -> None:
        table = make_table(self.CONTENT)
        run_table(table, steps=MARKING)
        frame = table_frame(table, table_cells(table))
        headers = ["Method", "kitchen: LLM-Match", "all: LLM-Match", "scored kitchen", "scored all"]
        assert frame.columns.tolist() == headers
        assert frame.iloc[0, 3:].tolist() == ["4 of 4", "6 of 6"]
        assert frame.iloc[1].tolist() == ["  paper", "1.5", "", "", ""]

    @pytest.mark.parametrize("part", [None, "cellar"])
    def test_column_without_a_known_part_is_refused(self, make_table: MakeTable, part: str | None) -> None:
        with pytest.raises(InputError, match="part"):
            make_table(merged(self.CONTENT, {"columns.few.part": part}))


def test_frame_has_ours_the_papers_and_intervals_below_one_another(make_table: MakeTable) -> None:
    table = make_table()
    run_table(table, steps=MARKING)
    cells = table_cells(table)
    frame = table_frame(table, cells)
    lines = frame["Method"].tolist()
    assert lines == [
        "Volume score",
        "  paper",
        "  95 %",
        "ours",
        "  paper",
        "  95 %",
        "initial",
        "  95 %",
        "Human",
        "  paper",
    ]
    assert frame.iloc[0].tolist() == ["Volume score", "50.0", "2.0", "–", "6 of 6"]
    assert 0 < float(frame.iloc[3]["p"]) < 1
    assert frame.iloc[1].tolist() == ["  paper", "47.8", "2.7", "", ""]
    assert frame.iloc[8].tolist() == ["Human", "–", "–", "–", "–"]
    assert frame.iloc[9].tolist() == ["  paper", "86.8", "Full", "", ""]
    told = notes(table, cells)
    assert any("2 scenes are too few" in note for note in told)
    latex = to_latex(frame, ["Method"], told)
    assert r"Volume score & 50.0 & 2.0 & -- & 6 of 6 \\" in latex
    rows = [*csv.DictReader(io.StringIO(to_csv(pd.DataFrame(cell_rows(table, cells)))))]
    assert len(rows) == 4 * 3
    assert (rows[0]["row"], rows[0]["ours"], rows[0]["paper"], rows[0]["scored"]) == (
        "Volume score",
        "50.0",
        "47.8",
        "6",
    )


class TestBadFiles:
    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"columns.match.metric": "blue"}, "metric"),
            ({"columns.p.against": "nobody"}, "nobody"),
            ({"columns.match.value": "p"}, "against"),
            ({"rows.initial.run": "human"}, "no row with a change"),
            ({"rows.ours.run": "volume"}, "change or run"),
            ({"rows.ours.reference": {"blue": 1}}, "blue"),
            ({"rows.volume.colour": "red"}, "colour"),
            ({"name": "a/b"}, "letters"),
            ({"rows.a/b": {"label": "a"}}, "letters"),
            ({"rows": 3}, "rows"),
        ],
    )
    def test_wrong_fields_are_refused_by_name(self, make_table: MakeTable, change: dict[str, Any], said: str) -> None:
        with pytest.raises(InputError, match=said):
            make_table(**change)

    def test_wrong_job_is_refused_before_any_run(self, make_table: MakeTable) -> None:
        table = make_table(**{"rows.ours.change": {"method.judging.verfy": True}})
        with pytest.raises(InputError, match="verfy") as raised:
            run_table(table, steps=MARKING)
        assert "row ours" in str(raised.value)
        assert not asked

    def test_unknown_row_is_refused(self, make_table: MakeTable) -> None:
        with pytest.raises(InputError, match="nobody"):
            run_table(make_table(), ("nobody",), steps=MARKING)

    def test_arm_that_a_run_lacks_is_refused(self, make_table: MakeTable) -> None:
        table = make_table(**{"rows.initial.arm": "middle"})
        run_table(table, steps=MARKING)
        with pytest.raises(InputError, match=r"rows\.initial\.arm"):
            table_cells(table)

    def test_file_without_an_output_needs_one(self, tmp_path: Path) -> None:
        path = tmp_path / "table.yaml"
        path.write_text(yaml.safe_dump(CONTENT))
        with pytest.raises(InputError, match="--output"):
            load_table(path)
        assert load_table(path, output=str(tmp_path)).output == str(tmp_path)


class TestMerged:
    def test_fields_with_points_are_paths(self) -> None:
        assert merged({"a": {"b": 1, "c": 2}}, {"a.b": 3, "d.e": 4}) == {"a": {"b": 3, "c": 2}, "d": {"e": 4}}

    def test_lists_and_values_are_replaced_whole(self) -> None:
        assert merged({"a": [1, 2], "b": {"c": 1}}, {"a": [3], "b": None}) == {"a": [3], "b": None}

    def test_method_of_another_kind_has_settings_of_its_own(self) -> None:
        base = {"method": {"novel_views": {"count": 0}}}
        assert merged(base, {"method": {"kind": "blind"}}) == {"method": {"kind": "blind"}}
        same = merged(base, {"method": {"kind": "splatreasoner", "judging": {"verify": False}}})
        assert same["method"]["novel_views"] == {"count": 0}

    def test_neither_side_is_changed(self) -> None:
        base, change = {"a": {"b": 1}}, {"a": {"c": 2}}
        merged(base, change)
        assert (base, change) == ({"a": {"b": 1}}, {"a": {"c": 2}})


@pytest.mark.parametrize("path", sorted(PRESETS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_preset_loads_and_its_jobs_are_jobs(path: Path) -> None:
    table = load_table(path.stem)
    assert table.config.name == path.stem
    assert table.config.caption
    assert all(table.job(run).output for run in table.runs())


class TestFigures:
    """A run made up, with every task, status and reason for being unscored."""

    COLUMNS: ClassVar[dict[str, Any]] = {
        "match": {"label": "LLM-Match", "metric": "llm_match"},
        "place": {"label": "of places", "metric": "llm_match", "category": "object localization"},
        "many": {"label": "mIoU", "metric": "instance_miou"},
        "zero": {"label": "zero", "metric": "zero_target"},
        "frames": {"label": "Frames", "metric": "frames"},
        "calls": {"label": "calls", "metric": "calls", "category": "object localization"},
    }

    def _cells(self, tmp_path: Path, **run: Any) -> tuple[Table, dict[str, Cell], str]:
        path = tmp_path / "table.yaml"
        rows = {"ours": {"label": "ours", "change": {}}}
        content = {"name": "t", "base": {"output": "out", "scenes": "scenes"}, "columns": self.COLUMNS, "rows": rows}
        path.write_text(yaml.safe_dump(content, sort_keys=False))
        table = load_table(path)
        place = write_run(Path(table.place(*table.runs())), **run)
        return table, {cell.column: cell for cell in table_cells(table)}, place

    def test_are_those_of_aggregate(self, tmp_path: Path) -> None:
        _, cells, run = self._cells(tmp_path)
        rows = aggregate(run)["arms"].query("arm == 'verified'").set_index("metric")
        for column, metric in (("match", "llm_match"), ("many", "instance_miou"), ("zero", "zero_target")):
            wanted = rows.loc[metric]
            assert cells[column].value == pytest.approx(wanted["mean"])
            assert cells[column].zero == pytest.approx(wanted["mean_zero"])
            counts = cells[column].scored, cells[column].questions, cells[column].scenes
            assert counts == (wanted["scored"], wanted["questions"], wanted["scenes"])
        assert cells["match"].scored < cells["match"].questions == 30
        assert cells["frames"].zero is None

    def test_a_category_is_kept_alone(self, tmp_path: Path) -> None:
        _, cells, run = self._cells(tmp_path)
        rows = aggregate(run)["by_category"].query("arm == 'verified' and category == 'object localization'")
        assert cells["place"].value == pytest.approx(rows.set_index("metric").loc["llm_match"]["mean"])
        assert cells["place"].questions == cells["calls"].questions == 15

    def test_unscored_and_pending_questions_are_told(self, tmp_path: Path) -> None:
        table, cells, _ = self._cells(tmp_path, committed=1)
        assert (cells["match"].questions, cells["match"].pending) == (30, 20)
        told = " ".join(notes(table, [*cells.values()]))
        assert "INCOMPLETE: ours: 20 of 30 questions are pending" in told
        frame = table_frame(table, [*cells.values()])
        assert frame["Method"].tolist() == ["ours", "  95 %", "  if 0"]
        assert "if 0:" in told
