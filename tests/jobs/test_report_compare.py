"""The page of a comparison: both runs' questions in pairs, differences as compare_runs has them, links that hold."""

from __future__ import annotations

import json
import re
from pathlib import Path
from urllib.parse import unquote

import pytest

from jobs.report.compare_page import OUTCOMES, write_comparison
from jobs.report.pictures import DrawingBudget
from jobs.scoring.compare import Comparison, compare_runs
from jobs.scoring.scores import Options
from tests.jobs.synthetic_run import EVIL, write_run
from tests.jobs.test_cli import run
from tests.jobs.test_report import Page, data_of

QUICK = Options(resamples=100)
NOTHING_DRAWN = DrawingBudget(questions=0)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Comparison:
    runs = [
        write_run(tmp_path_factory.mktemp("a"), seed=0),
        write_run(tmp_path_factory.mktemp("b run"), seed=1, committed=2),
    ]
    return compare_runs(*runs, options=QUICK)


@pytest.fixture(scope="module")
def page(found: Comparison, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_comparison(found, tmp_path_factory.mktemp("pages") / "both.html", drawing=NOTHING_DRAWN)


def test_comparison_page_pairs_records_and_says_where_one_run_has_none(page: Path) -> None:
    listed = data_of(page, "list", "both-data")
    pairs = [pair for number in range(2) for pair in data_of(page, f"q{number}", "both-data")["records"]]
    assert len(pairs) == len(listed["rows"]) == 60
    for row, (a, b) in zip(listed["rows"], pairs, strict=True):
        assert a["id"] == row[0]
        assert b is None or b["id"] == row[0]
        assert (b is None) == (a["scene"] == "maison <b>3</b>")


def test_comparison_page_labels_agree_with_the_differences(page: Path, found: Comparison) -> None:
    rows = data_of(page, "list", "both-data")["rows"]
    labels = list(OUTCOMES)
    last = found.questions.drop_duplicates("question_id", keep="last").set_index("question_id")
    for row in rows:
        told = {label for bit, label in enumerate(labels) if row[7] >> bit & 1}
        difference, changed = last.loc[row[0], "difference"], last.loc[row[0], "changed"]
        wanted = "unscored" if difference != difference else "better" if difference > 0 else "worse"
        assert told == {"changed" if changed else "same", *((wanted,) if difference else ())}


def test_comparison_page_links_thumbnails_where_the_runs_keep_them(page: Path) -> None:
    pairs = data_of(page, "q0", "both-data")["records"]
    for record in pairs[0]:
        images = [view["image"] for cluster in record["clusters"] for view in cluster["candidates"] if view["image"]]
        assert len(images) == 8
        for image in images:
            assert not re.search(r"[ ?#<>&'\"]", image)
            assert (page.parent / unquote(image)).is_file()


def test_comparison_page_shows_warnings_and_hostile_names_as_text(page: Path) -> None:
    shown = Page(page.read_text())
    assert len(shown.scripts) == 2
    assert EVIL in shown.text
    assert "INCOMPLETE" in shown.text
    assert not [tag for tag, _ in shown.elements if tag in ("img", "iframe", "b")][2:], "A and B are bold, no more"


def test_comparison_page_cut_list_says_so(found: Comparison, tmp_path: Path) -> None:
    page = write_comparison(found, tmp_path / "c.html", max_questions=5, drawing=NOTHING_DRAWN)
    assert len(data_of(page, "list", "c-data")["rows"]) == 5
    assert "first 5 of 60 questions" in Page(page.read_text()).text


def test_verbs_write_pages_and_say_where(found: Comparison, tmp_path: Path) -> None:
    ended = run("report", found.runs[0], "--overlays", "0")
    assert (ended.returncode, ended.stdout) == (0, f"{found.runs[0]}/report.html\n")
    page = tmp_path / "new" / "c.html"
    ended = run("compare", *found.runs, "--page", page, "--overlays", "0", "--json")
    assert ended.returncode == 0
    assert json.loads(ended.stdout)["a"] == found.runs[0]
    assert ended.stderr.splitlines()[-1] == str(page)
    assert page.is_file()


def test_verb_report_of_no_run_ends_with_what_was_expected(tmp_path: Path) -> None:
    ended = run("report", tmp_path)
    assert ended.returncode == 2
    assert "expected a run folder" in ended.stderr
