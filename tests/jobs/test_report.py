"""The report: one page from the run folder, everything escaped, nothing from elsewhere, every question explained."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from jobs.report import write_report
from jobs.report.curves import Dot, dot_plot, growth_plot
from jobs.report.pictures import DrawingBudget, spread
from jobs.report.plots import WIDTH, Bar, BarGroup, bar_plot
from jobs.report.questions import labels_of
from jobs.report.shards import script_of
from jobs.report.spending import spending_plot
from jobs.runs.progress import Silent
from jobs.scoring.scores import Options
from schemas.errors import InputError
from schemas.run_folder import read_table
from tests.jobs.synthetic_run import EVIL, write_run

QUICK = Options(resamples=100)
NOTHING_DRAWN = DrawingBudget(questions=0)


class Page(HTMLParser):
    """Elements, and the text of scripts, of a page."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.text = ""
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._inside = tag

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.scripts.append(data)
        else:
            self.text += data
        self._inside = ""


def data_of(page: Path, name: str, folder: str = "report") -> Any:
    """Return what a script beside a page hands over; it must be that one call and nothing else."""
    text = (page.parent / folder / f"{name}.js").read_bytes().decode("ascii")
    found = re.fullmatch(rf"splat\('{name}','((?:[^'\\\n]|\\.)*)'\);\n", text)
    assert found is not None
    assert not set("<>&") & set(text)
    return json.loads(re.sub(r"\\(.)", r"\1", found[1]))


def records_of(page: Path) -> list[dict[str, Any]]:
    """Return all questions of a page."""
    count = len(list((page.parent / "report").glob("q*.js")))
    return [record for number in range(count) for record in data_of(page, f"q{number}")["records"]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def path(run: str) -> Path:
    return Path(write_report(run, options=QUICK))


@pytest.fixture(scope="module")
def report(path: Path) -> Page:
    assert path.name == "report.html"
    return Page(path.read_text())


def test_report_hostile_text_makes_no_element(report: Page) -> None:
    assert len(report.scripts) == 2
    assert [script for script in report.scripts if EVIL in script] == []
    assert not [tag for tag, _ in report.elements if tag in ("img", "iframe", "object", "embed", "link", "base")]
    assert not [name for _, attributes in report.elements for name in attributes if name.startswith("on")]
    assert not [tag for tag, attributes in report.elements if "style" in attributes]
    assert EVIL in report.text, "the run's name is shown as text"


def test_report_policy_names_its_scripts_and_style_by_hash_and_no_address(report: Page, path: Path) -> None:
    for _, attributes in report.elements:
        for name in ("src", "action", "data", "poster"):
            assert attributes.get(name) is None
        assert (attributes.get("href") or "#").startswith("#")
    policy = next(a["content"] for t, a in report.elements if t == "meta" and a.get("http-equiv"))
    assert policy is not None
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert "unsafe" not in policy
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in report.scripts]
    assert " ".join(["script-src", *(f"'sha256-{digest}'" for digest in digests), "'strict-dynamic'"]) in policy


def test_report_twice_is_the_same_bytes_and_leaves_no_old_data(run: str, path: Path) -> None:
    files = {file: file.read_bytes() for file in [path, *(path.parent / "report").iterdir()]}
    (path.parent / "report" / "q77.js").write_text("old")
    write_report(run, options=QUICK)
    assert {file: file.read_bytes() for file in [path, *(path.parent / "report").iterdir()]} == files


def test_report_holds_every_question_with_what_led_to_its_answer(path: Path) -> None:
    questions, listed = records_of(path), data_of(path, "list")
    ids = [f"q{n:04d}" for scene in range(3) for n in range(scene, 60, 3)]
    assert [q["id"] for q in questions] == ids
    assert [row[0] for row in listed["rows"]] == ids
    first = questions[0]
    assert first["evidence"] == ["sofa", "lamp"]
    assert [arm["arm"] for arm in first["arms"]] == ["initial", "final", "verified"]
    assert [cluster["category"] for cluster in first["clusters"]] == ["sofa", "lamp"]
    moves = [candidate["move"] for candidate in first["clusters"][0]["candidates"]]
    assert moves == ["initial", "left", "right", "forward", "backward"]
    assert [c["chosen"] for c in first["clusters"][0]["candidates"]] == [False, True, False, False, False]
    assert len(first["calls"]) >= 13
    assert {q["status"] for q in questions} == {"answered", "failed", "unparsed", "skipped"}
    labels = [label for label, _ in listed["labels"]]
    for question, row in zip(questions, listed["rows"], strict=True):
        assert [label for bit, label in enumerate(labels) if row[7] >> bit & 1] == sorted(
            question["labels"], key=labels.index
        )


def test_report_holds_every_request_as_it_was_sent_and_each_line_once(run: str, path: Path) -> None:
    sent = read_table(run, "calls").groupby("question_id", sort=False)["prompt"].apply(list)
    for number in range(2):
        shard = data_of(path, f"q{number}")
        lines = shard["lines"]
        assert len(set(lines)) == len(lines)
        for record in shard["records"]:
            told = ["\n".join(lines[place] for place in call["sent"]) for call in record["calls"]]
            assert told == sent[record["id"]]
    assert any(EVIL in text for text in sent["q0000"])


def test_report_tells_how_far_writing_is(tmp_path: Path) -> None:
    told: list[str] = []

    class Told(Silent):
        def begin(self, total: int, done: int) -> None:
            told.append(f"{total} to write")

        def advance(self, error: str) -> None:
            told.append("one")

        def say(self, text: str) -> None:
            told.append(text)

        def end(self) -> None:
            told.append("end")

    write_report(write_run(tmp_path, 6), options=QUICK, drawing=NOTHING_DRAWN, writing=Told())
    assert told == ["reading the tables", "computing the scores", "6 to write", *["one"] * 6, "end"]


def test_report_names_thumbnails_that_exist_and_no_others(path: Path) -> None:
    for question in records_of(path)[:4]:
        for cluster in question["clusters"]:
            for candidate in cluster["candidates"]:
                if candidate["move"] == "backward":
                    assert candidate["image"] is None
                else:
                    assert (path.parent / candidate["image"]).is_file()


def test_report_says_denominators_and_that_symbolic_is_no_vlm(report: Page) -> None:
    assert "60 of 60 questions committed" in report.text
    assert "not a VLM" in report.text
    assert "23 of 30" in report.text
    assert "not complete" not in report.text


def test_report_scene_not_at_hand_says_so_and_still_maps_the_views(path: Path) -> None:
    scenery = data_of(path, "list")["scenery"]
    assert len(scenery["maps"]) == 3
    assert scenery["problems"]
    assert all("cannot be used: the plan's path is not here" in problem for _, problem in scenery["problems"])
    for _, frame in scenery["maps"]:
        assert "image" not in frame
        assert min(frame["size"]) > 0


def test_report_of_an_unfinished_run_says_so(tmp_path: Path) -> None:
    run = write_run(tmp_path, committed=1)
    page = Page(Path(write_report(run, options=QUICK, drawing=NOTHING_DRAWN)).read_text())
    assert "20 of 60 questions committed" in page.text
    assert "not complete" in page.text


@pytest.mark.parametrize("committed", [0, None])
def test_report_of_a_tiny_or_empty_run_is_written(tmp_path: Path, committed: int | None) -> None:
    page = Path(write_report(write_run(tmp_path, questions=3, committed=committed), options=QUICK))
    assert len(records_of(page)) == (3 if committed is None else 0)


def test_report_cut_list_says_what_is_left_out(tmp_path: Path) -> None:
    path = Path(write_report(write_run(tmp_path), options=QUICK, max_questions=7, drawing=NOTHING_DRAWN))
    assert len(records_of(path)) == len(data_of(path, "list")["rows"]) == 7
    page = Page(path.read_text())
    assert "first 7 of 60 questions" in page.text
    assert "60 of 60 questions committed" in page.text


def test_report_no_run_raises(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        write_report(tmp_path)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(JSON)
@example(EVIL + "\\' \\\\'); alert(1); ('\ud800\u2029")
def test_script_of_any_data_is_one_call_that_hands_it_over(data: Any) -> None:
    text = script_of("list", data).decode("ascii")
    found = re.fullmatch(r"splat\('list','((?:[^'\\\n]|\\.)*)'\);\n", text)
    assert found is not None
    assert not set("<>&") & set(text)
    assert json.loads(re.sub(r"\\(.)", r"\1", found[1])) == data


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
    assert all(end <= WIDTH for end in ends)
    assert bar_plot([], ("a",), "empty").endswith("</svg>")


def test_growth_plot_ends_where_the_last_point_is() -> None:
    svg = growth_plot([(0.0, 0.0), (5.0, 40.0), (10.0, 100.0)], "minutes", "<calls>", "spent")
    assert "&lt;calls&gt;" in svg
    (curve,) = re.findall(r'class="curve" d="M([^"]+)"', svg)
    (_, _), (x1, y1), (x2, y2) = [map(float, point.split()) for point in curve.split("L")]
    assert (x2, y2) == (406.0, 12.0)
    assert x1 == (58 + 406) / 2
    assert y1 == pytest.approx(12 + 0.6 * (230 - 12 - 40), abs=0.1)


def test_dot_plot_dots_lie_inside_and_speak() -> None:
    svg = dot_plot([Dot(0.2, 80.0, "<a>", 0), Dot(3.0, 10.0, "b", 1, 0.1)], "seconds", "error", "time")
    assert "<title>&lt;a&gt;</title>" in svg
    for x, y in re.findall(r'cx="([0-9.]+)" cy="([0-9.]+)"', svg):
        assert 58 <= float(x) <= 406
        assert 12 <= float(y) <= 190


def test_spread_draws_some_of_every_task_and_label() -> None:
    listed = [{"task": "eqa", "labels": ["right"]} for _ in range(50)]
    listed += [{"task": "eqa", "labels": ["wrong", "novel"]}, {"task": "ground_one", "labels": ["right"]}]
    chosen = spread(listed, 6)
    assert len(chosen) == len(set(chosen)) == 6
    assert {50, 51} <= set(chosen)
    assert sorted(spread(listed, 1_000)) == list(range(52))
    assert spread(listed, 0) == spread([], 5) == []


def test_spending_plot_leaves_out_the_time_between_sessions() -> None:
    calls = {"calls": 10, "cached": 0, "failed_tries": 0, "tokens": 100, "usd": None}
    events: list[dict[str, Any]] = [
        {"time": "2026-01-01T00:00:00+00:00", "event": "started"},
        {"time": "2026-01-01T00:01:00+00:00", "event": "committed", "calls": calls},
        {"time": "no time", "event": "committed", "calls": calls},
        {"time": "2026-01-02T00:00:00+00:00", "event": "started"},
        {"time": "2026-01-02T00:01:00+00:00", "event": "committed", "calls": calls},
    ]
    svg = spending_plot(events)
    assert "tokens" in svg
    (curve,) = re.findall(r'class="curve" d="M([^"]+)"', svg)
    assert curve.split("L")[-1].split() == ["406.0", "12.0"], "two minutes and 200 tokens are the ends of the axes"
    assert spending_plot(events[:2]) == ""
