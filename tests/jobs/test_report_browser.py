"""The pages as people meet them: opened from disk in Chromium, on a desk and on a phone, by mouse and by keyboard."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from jobs.report import write_report
from jobs.report.compare_page import write_comparison
from jobs.report.pictures import DrawingBudget
from jobs.scoring.compare import compare_runs
from jobs.scoring.scores import Options
from tests.jobs.browser import Tab, browse, find_browser
from tests.jobs.synthetic_run import EVIL, write_run

pytestmark = pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine")

QUICK = Options(resamples=100)
NOTHING_DRAWN = DrawingBudget(questions=0)
LEAST_CONTRAST = 4.5
"""WCAG 2.1, level AA, for text of any size."""
MOST_SHIFT = 0.1
"""Of the layout while a page opens: a good one by the Web Vitals."""
SHIFT = """new Promise((done) => new PerformanceObserver((list) => done(
    list.getEntries().filter((one) => !one.hadRecentInput).reduce((sum, one) => sum + one.value, 0)
)).observe({ type: "layout-shift", buffered: true }) ?? setTimeout(() => done(0), 100))"""
LISTED = "document.querySelectorAll('#rows li').length"
OPENED = "document.querySelector('#question .step')"

CONTRAST, NAMELESS, STRUCTURE = (
    Path(__file__).with_name(f"{name}.js").read_text() for name in ("contrast", "nameless", "structure")
)
"""Expressions that are evaluated in the page."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    run = write_run(tmp_path_factory.mktemp("run"), questions=120)
    return f"file://{write_report(run, options=QUICK)}"


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> str:
    runs = [write_run(tmp_path_factory.mktemp(name), seed=seed) for seed, name in enumerate("ab")]
    output = tmp_path_factory.mktemp("pages") / "a against b?#.html"
    found = compare_runs(*runs, options=QUICK)
    return write_comparison(found, output, drawing=NOTHING_DRAWN).as_uri()


def _quietly(tmp_path: Path, work: Callable[[Tab], Awaitable[Any]]) -> Any:
    """Do it, and check that nothing was complained of, nothing asked of the network and no hostile text ran."""

    async def checked(tab: Tab) -> Any:
        found = await work(tab)
        assert await tab.run("document.title") != "owned"
        assert tab.complaints() == []
        assert [uri for uri in tab.requests() if not uri.startswith(("file:", "about:"))] == []
        return found

    return browse(tmp_path, checked)


async def _size(tab: Tab, width: int, height: int, theme: str) -> None:
    await tab.send(
        "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500
    )
    await tab.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])


def test_page_filters_pages_and_opens_questions_from_the_keyboard(page: str, tmp_path: Path) -> None:
    async def work(tab: Tab) -> None:
        await tab.open(f"{page}#questions", LISTED)
        assert await tab.run(LISTED) == 50
        assert "1 to 50 of 120 questions" in await tab.run("document.getElementById('count').textContent")
        await tab.run("document.getElementById('later').click()")
        await tab.until("document.getElementById('count').textContent.startsWith('51 to 100')")
        assert await tab.run("location.hash") == "#questions?page=2"
        await tab.run("document.querySelector('#labels button[value=failed]').click()")
        assert await tab.run(LISTED) == 6
        assert await tab.run("location.hash") == "#questions?label=failed"
        await tab.key("/")
        await tab.until("document.activeElement.id === 'find'")
        for key in "q0045":
            await tab.key(key)
        await tab.until(f"{LISTED} === 1")
        await tab.run("document.querySelector('#rows a').click()")
        await tab.until(OPENED)
        assert "q0045" in await tab.run("document.getElementById('question').textContent")
        await tab.key("Escape")
        await tab.until("!document.getElementById('questions').hidden")
        assert await tab.run("location.hash") == "#questions?label=failed&find=q0045"
        await tab.open(f"{page}#q=q0003", OPENED)
        await tab.key("j")
        shown = "document.getElementById('question').textContent.includes('q0006')"
        await tab.until(f"location.hash === '#q=q0006' && {shown}")

    _quietly(tmp_path, work)


def test_page_question_shows_views_answers_calls_and_prompts_of_hostile_text(page: str, tmp_path: Path) -> None:
    async def work(tab: Tab) -> None:
        await tab.open(f"{page}#q=q0000", OPENED)
        shots = "[...document.querySelectorAll('.shot img')]"
        await tab.run(f"{shots}.forEach((i) => (i.loading = 'eager'))")
        await tab.until(f"{shots}.every((i) => i.complete)")
        assert await tab.run(f"{shots}.filter((i) => i.naturalWidth === 256).length") == 8
        assert await tab.run("document.querySelectorAll('.shot.none').length") == 2
        assert await tab.run("document.querySelectorAll('svg.map .eye.chosen').length") == 2
        assert "cannot be used" in await tab.run("document.getElementById('question').textContent")
        assert await tab.run("document.querySelectorAll('#question b, #question img[src=x]').length") < 40
        await tab.run("document.querySelector('.call summary').click()")
        await tab.until("document.querySelector('.call pre')")
        request, reply = await tab.run("[...document.querySelectorAll('.call pre')].map((e) => e.textContent)")
        assert request.startswith("=== system ===\n")
        assert EVIL in request
        assert reply == "A sofa. "
        await tab.run("document.querySelector('button.shot').click()")
        await tab.until("document.getElementById('large').open")
        assert "</script><script>" in await tab.run("document.querySelector('#question h2').textContent")

    _quietly(tmp_path, work)


def test_page_of_a_run_that_kept_no_requests_says_so(tmp_path: Path) -> None:
    page = write_report(write_run(tmp_path / "run", 3, prompts=False), options=QUICK, drawing=NOTHING_DRAWN)

    async def work(tab: Tab) -> None:
        await tab.open(f"file://{page}#q=q0000", OPENED)
        await tab.run("document.querySelector('.call summary').click()")
        await tab.until("document.querySelector('.call pre')")
        assert "This run kept none" in await tab.run("document.querySelector('.call .inside').textContent")

    _quietly(tmp_path, work)


@pytest.mark.parametrize(
    ("width", "height", "theme"),
    [
        (1280, 900, "light"),
        (390, 844, "dark"),
        pytest.param(1280, 900, "dark", marks=pytest.mark.slow),
        pytest.param(390, 844, "light", marks=pytest.mark.slow),
    ],
)
def test_page_is_readable_named_and_no_wider_than_the_screen(
    page: str, comparison: str, tmp_path: Path, width: int, height: int, theme: str
) -> None:
    async def work(tab: Tab) -> None:
        await _size(tab, width, height, theme)
        for uri, tabs in ((page, ("overview", "scores", "cost", "run")), (comparison, ("overview", "changes"))):
            routes = [(route, "true") for route in tabs]
            for route, ready in [*routes, ("questions", LISTED), ("q=q0007", OPENED)]:
                await tab.open(f"{uri}#{route}", ready)
                worst = await tab.run(CONTRAST)
                assert worst[0] >= LEAST_CONTRAST, (route, worst)
                assert await tab.run(NAMELESS) == [], route
                await tab.run("document.querySelectorAll('.call').forEach((call) => (call.open = true))")
                assert await tab.run(STRUCTURE) == [], route
                assert await tab.run(SHIFT) < MOST_SHIFT, route
                wide = await tab.run("document.documentElement.scrollWidth - document.documentElement.clientWidth")
                assert wide <= 0, route

    _quietly(tmp_path, work)


def test_page_theme_button_goes_round(page: str, tmp_path: Path) -> None:
    async def work(tab: Tab) -> None:
        await tab.open(page)
        seen = []
        for _ in range(3):
            await tab.run("document.getElementById('theme').click()")
            seen.append(await tab.run("document.documentElement.dataset.theme ?? ''"))
        assert seen == ["light", "dark", ""]

    _quietly(tmp_path, work)


def test_page_without_its_data_says_so(page: str, tmp_path: Path) -> None:
    alone = tmp_path / "alone.html"
    alone.write_bytes(Path(page.removeprefix("file://")).read_bytes())

    async def work(tab: Tab) -> str:
        await tab.open(f"file://{alone}#questions", "document.querySelector('#count .notice')")
        return str(await tab.run("document.getElementById('count').textContent"))

    assert "keep both together" in browse(tmp_path / "profile", work)


def test_page_injected_script_is_refused(page: str, tmp_path: Path) -> None:
    async def work(tab: Tab) -> list[dict[str, Any]]:
        await tab.open(page)
        for markup in ("<img src=data:, onerror=document.title=1>", "<script src=report/list.js></script>"):
            await tab.run(f"document.body.append(document.createRange().createContextualFragment({markup!r}))")
        await tab.until("true")
        assert await tab.run("document.title") != "1"
        return tab.complaints()

    assert "Content Security Policy" in str(browse(tmp_path, work))


def test_comparison_shows_both_sides(comparison: str, tmp_path: Path) -> None:
    async def work(tab: Tab) -> None:
        await tab.open(f"{comparison}#questions?label=better&order=gain", LISTED)
        trails = await tab.run("[...document.querySelectorAll('.trail')].map((e) => e.textContent)")
        changes = [float(b) - float(a) for a, b in (trail.split(" → ") for trail in trails)]
        assert changes == sorted(changes, reverse=True)
        assert min(changes) > 0
        await tab.open(f"{comparison}#q=q0007", OPENED)
        assert await tab.run("document.querySelectorAll('.side .verdict').length") == 2
        shots = "[...document.querySelectorAll('.shot img')]"
        await tab.run(f"{shots}.forEach((i) => (i.loading = 'eager'))")
        await tab.until(f"{shots}.every((i) => i.complete)")
        assert await tab.run(f"{shots}.filter((i) => i.naturalWidth === 256).length") == 16

    _quietly(tmp_path, work)
