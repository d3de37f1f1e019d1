"""The report: one page from the run folder, everything escaped, nothing from elsewhere, every question explained."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from jobs.report import write_report
from jobs.report.plots import Bar, BarGroup, bar_plot
from jobs.report.questions import labels_of
from jobs.scores import Options
from schemas.errors import InputError
from tests.jobs.synthetic_run import EVIL, write_run

QUICK = Options(resamples=100)


class Page(HTMLParser):
    """Elements, and the text of scripts, of a page."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.text = ""
        self._script: dict[str, str | None] | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._script = dict(attrs) if tag == "script" else None

    def handle_data(self, data: str) -> None:
        if self._script is not None:
            self.scripts.append((self._script, data))
            self._script = None
        else:
            self.text += data


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def report(run: str) -> Page:
    path = Path(write_report(run, options=QUICK))
    assert path.name == "report.html"
    return Page(path.read_text())


def _questions(page: Page) -> list[dict[str, Any]]:
    (data,) = [text for attributes, text in page.scripts if attributes.get("type") == "application/json"]
    return list(json.loads(data))


def test_report_hostile_text_makes_no_element(report: Page) -> None:
    assert [attributes for attributes, _ in report.scripts] == [{"type": "application/json", "id": "questions"}, {}]
    assert not [tag for tag, _ in report.elements if tag in ("img", "iframe", "object", "embed", "link", "b")]
    assert not [name for _, attributes in report.elements for name in attributes if name.startswith("on")]
    assert EVIL in report.text, "the run's name is shown as text"


def test_report_asks_nothing_of_the_network(report: Page) -> None:
    for _, attributes in report.elements:
        for name in ("src", "href", "action", "data", "poster"):
            assert attributes.get(name) is None
    policy = next(a["content"] for t, a in report.elements if t == "meta" and a.get("http-equiv"))
    assert policy is not None
    assert "default-src 'none'" in policy
    assert "http" not in policy


def test_report_twice_is_the_same_bytes(run: str) -> None:
    path = Path(write_report(run, options=QUICK))
    first = path.read_bytes()
    assert Path(write_report(run, options=QUICK)).read_bytes() == first


def test_report_holds_every_question_with_what_led_to_its_answer(report: Page) -> None:
    questions = _questions(report)
    assert [q["id"] for q in questions] == [f"q{n:04d}" for scene in range(3) for n in range(scene, 60, 3)]
    first = questions[0]
    assert first["evidence"] == ["sofa", "lamp"]
    assert [arm["arm"] for arm in first["arms"]] == ["initial", "final", "verified"]
    assert [cluster["category"] for cluster in first["clusters"]] == ["sofa", "lamp"]
    moves = [candidate["move"] for candidate in first["clusters"][0]["candidates"]]
    assert moves == ["initial", "left", "right", "forward", "backward"]
    assert [c["chosen"] for c in first["clusters"][0]["candidates"]] == [False, True, False, False, False]
    assert len(first["calls"]) >= 16
    assert all(len(call["reply"]) <= 600 for question in questions for call in question["calls"])
    assert {q["status"] for q in questions} == {"answered", "failed", "unparsed", "skipped"}


def test_report_names_thumbnails_that_exist_and_no_others(report: Page, run: str) -> None:
    for question in _questions(report)[:4]:
        for cluster in question["clusters"]:
            for candidate in cluster["candidates"]:
                if candidate["move"] == "backward":
                    assert candidate["image"] is None
                else:
                    assert Path(run, candidate["image"]).is_file()


def test_report_says_denominators_and_that_symbolic_is_no_vlm(report: Page) -> None:
    assert "60 of 60 questions committed" in report.text
    assert "not a VLM" in report.text
    assert "23 of 30" in report.text
    assert "not complete" not in report.text


def test_report_of_an_unfinished_run_says_so(tmp_path: Path) -> None:
    page = Page(Path(write_report(write_run(tmp_path, committed=1), options=QUICK)).read_text())
    assert "20 of 60 questions committed" in page.text
    assert "not complete" in page.text


@pytest.mark.parametrize("committed", [0, None])
def test_report_of_a_tiny_or_empty_run_is_written(tmp_path: Path, committed: int | None) -> None:
    page = Page(Path(write_report(write_run(tmp_path, questions=3, committed=committed), options=QUICK)).read_text())
    assert len(_questions(page)) == (3 if committed is None else 0)


def test_report_cut_list_says_what_is_left_out(tmp_path: Path) -> None:
    page = Page(Path(write_report(write_run(tmp_path), options=QUICK, max_questions=7)).read_text())
    assert len(_questions(page)) == 7
    assert "first 7 of 60 questions" in page.text
    assert "60 of 60 questions committed" in page.text


def test_report_no_run_raises(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        write_report(tmp_path)


def _arm(task: str, **values: Any) -> dict[str, Any]:
    empty = {"status": "answered", "answer": "a", "views": ("v0", "v1"), "chosen": (), "mark": None, "iou": None}
    return {"task": task, **empty, **values}


@pytest.mark.parametrize(
    ("status", "arms", "labels"),
    [
        ("answered", [_arm("eqa", mark=4)] * 3, {"right"}),
        ("answered", [_arm("eqa", mark=3)] * 3, {"wrong"}),
        ("answered", [_arm("eqa")] * 3, {"unscored"}),
        ("failed", [_arm("eqa", status="failed")] * 3, {"failed", "unscored"}),
        ("answered", [_arm("ground_one", iou=0.1)] * 3, {"wrong"}),
        ("answered", [_arm("ground_one", iou=0.11)] * 3, {"right"}),
        (
            "answered",
            [_arm("eqa", mark=1), _arm("eqa", answer="b", mark=5), _arm("eqa", mark=1)],
            {"novel", "novel-better", "verify", "verify-worse", "wrong"},
        ),
        (
            "answered",
            [_arm("eqa", mark=5), _arm("eqa", answer="b", mark=5), _arm("eqa", answer="b", mark=5)],
            {"novel", "right"},
        ),
        (
            "answered",
            [_arm("ground_one", chosen=(0,), iou=0.5), *[_arm("ground_one", chosen=(1,), iou=0.2)] * 2],
            {"novel", "novel-worse", "right"},
        ),
        ("answered", [_arm("eqa", views=("x",), mark=5), _arm("eqa", mark=5), _arm("eqa", mark=5)], {"right"}),
        ("skipped", [], {"skipped", "unscored"}),
    ],
)
def test_labels_of_question(status: str, arms: list[dict[str, Any]], labels: set[str]) -> None:
    found = labels_of(status, dict(zip(("initial", "final", "verified"), arms, strict=False)))
    assert set(found) == labels
    assert len(found) == len(labels)


def test_bar_plot_lengths_are_to_scale_and_text_is_escaped() -> None:
    groups = [BarGroup("<b>one", (Bar(40.0, 20.0, 60.0), Bar(None))), BarGroup("two", (Bar(80.0), Bar(0.0)))]
    svg = bar_plot(groups, ("first", "second"), "a & b")
    assert "<b>" not in svg
    assert "a &amp; b" in svg
    widths = [float(width) for width in re.findall(r'<rect class="s0"[^>]* width="([0-9.]+)"', svg)]
    assert widths[1] == pytest.approx(2 * widths[0], abs=0.2)
    assert svg.count('class="whisker"') == 1
    assert "–" in svg


@pytest.mark.parametrize("value", [0.0, 1e-6, 3.7, 99.9, 123_456.0])
def test_bar_plot_fits_its_frame(value: float) -> None:
    svg = bar_plot([BarGroup("x", (Bar(value), Bar(value / 2)))], ("a", "b"), "plot", stacked=True)
    ends = [float(x) + float(w) for x, w in re.findall(r'<rect[^>]* x="([0-9.]+)"[^>]* width="([0-9.]+)"', svg)]
    assert all(end <= 560 for end in ends)
    assert bar_plot([], ("a",), "empty").endswith("</svg>")


def test_report_page_works_in_a_browser(run: str, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine")
    path = write_report(run, options=QUICK)
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}", "--dump-dom"]
    dom = subprocess.run([*command, f"file://{path}#q=q0000"], capture_output=True, text=True, timeout=120, check=True)
    page = Page(dom.stdout)
    assert len([tag for tag, a in page.elements if tag == "details" and a.get("class") == "question"]) == 1
    pictures = [a["src"] for tag, a in page.elements if tag == "img"]
    assert len(pictures) == 8
    assert all(str(source).startswith("images/") for source in pictures)
    assert "1 of 60 questions" in page.text
    assert "<title>owned" not in dom.stdout
