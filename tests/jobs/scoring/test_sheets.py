"""Sheets: what a person reads agrees with the metrics, and no number is cut off in a terminal."""

from __future__ import annotations

import io
from pathlib import Path

import pandas as pd
import pytest
from rich.console import Console

from jobs.scoring.aggregate import aggregate
from jobs.scoring.scores import Options
from jobs.scoring.sheets import MIN_WIDTH, Sheet, format_tables, make_sheets, print_tables, sheet_by_key
from tests.jobs.synthetic_run import write_run

QUICK = Options(resamples=100)


@pytest.fixture(scope="module")
def metrics(tmp_path_factory: pytest.TempPathFactory) -> dict[str, pd.DataFrame]:
    return aggregate(write_run(tmp_path_factory.mktemp("run")), QUICK)


@pytest.fixture(scope="module")
def sheets(metrics: dict[str, pd.DataFrame]) -> list[Sheet]:
    return make_sheets(metrics)


def _sheet(sheets: list[Sheet], key: str) -> Sheet:
    sheet = sheet_by_key(sheets, key)
    assert sheet is not None
    return sheet


def test_make_sheets_every_row_fits_its_columns(sheets: list[Sheet]) -> None:
    assert len({sheet.key for sheet in sheets}) == len(sheets) == 17
    for sheet in sheets:
        assert sheet.rows
        assert all(len(row) == len(sheet.columns) for row in sheet.rows), sheet.key


def test_ablation_sheet_shows_arms_in_order_with_denominators(sheets: list[Sheet]) -> None:
    sheet = _sheet(sheets, "arms-eqa")
    assert [row[0] for row in sheet.rows] == ["initial", "final", "verified"]
    assert sheet.columns[-1] == "scored"
    assert all(row[-1] == "23 of 30" for row in sheet.rows)
    assert "With 3 scenes" in sheet.note


def test_denominators_sheet_counts_every_question(sheets: list[Sheet]) -> None:
    sheet = _sheet(sheets, "denominators")
    counts = [dict(zip(sheet.columns, row, strict=True)) for row in sheet.rows]
    for row in counts:
        parts = sum(int(row[name]) for name in ("answered", "unparsed", "failed", "skipped"))
        assert parts == int(row["questions"])


def test_make_sheets_of_a_run_without_committed_units_shows_denominators_and_no_score(tmp_path: Path) -> None:
    sheets = make_sheets(aggregate(write_run(tmp_path, committed=0), QUICK))
    for row in _sheet(sheets, "arms-eqa").rows:
        assert set(row[1:-1]) == {"–"}
        assert row[-1] == "0 of 30"
    sheet = _sheet(sheets, "denominators")
    for row in sheet.rows:
        counts = dict(zip(sheet.columns, row, strict=True))
        assert counts["pending"] == counts["questions"]


def test_format_tables_by_scene_only_when_asked(metrics: dict[str, pd.DataFrame]) -> None:
    assert len(format_tables(metrics, by_scene=True)) == len(format_tables(metrics)) + 4


def test_print_tables_shows_every_cell_whole(metrics: dict[str, pd.DataFrame]) -> None:
    console = Console(width=MIN_WIDTH, record=True, file=io.StringIO())
    for table in format_tables(metrics, by_scene=True):
        console.print(table)
    shown = console.export_text()
    assert "…" not in shown.replace(" … ", "")
    for sheet in make_sheets(metrics):
        for row in sheet.rows:
            for cell in row[sheet.words :]:
                assert cell in shown


def test_print_tables_on_a_narrow_terminal_cuts_nothing(
    metrics: dict[str, pd.DataFrame], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    print_tables(metrics)
    assert max(map(len, capsys.readouterr().out.splitlines())) > 80
