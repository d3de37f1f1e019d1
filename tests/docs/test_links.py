"""Links and files that pages name are there, and every page can be reached from the first and from the sidebar."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.conftest import ROOT

DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
LINK = re.compile(r"\]\(([^)\s]+)\)")
OWN_FILE = re.compile(r"(?<![\w./-])(?:benchmarks|docs|examples|jobs|pipeline|schemas|tests|workers)/[\w./-]+\.\w+")
OWN_SCRIPT = re.compile(r"python -m ((?:benchmarks|jobs|tests)[.\w]+)")
GENERATED = ("docs/_build/", "docs/api/")


def prose(page: Path) -> str:
    """The page without its code."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^ *```.*?^ *```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE))


def links(page: Path) -> list[tuple[Path, str]]:
    """Files a page links to, each with the place in it."""
    found = [target.partition("#") for target in LINK.findall(prose(page)) if "://" not in target]
    return [((page.parent / path).resolve() if path else page, anchor) for path, _, anchor in found]


def headings(page: Path, level: str = "#+") -> list[str]:
    """The headings of a page, of the levels that a pattern names."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    return re.findall(rf"^{level} (.+)$", text, re.MULTILINE)


def anchors(page: Path) -> set[str]:
    """Places in a page, named as GitHub and MyST do: lower case, hyphens for spaces, no punctuation."""
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings(page)}


EVERY_PAGE = pytest.mark.parametrize(
    "page", [ROOT / "README.md", *PAGES], ids=lambda page: page.relative_to(ROOT).as_posix()
)


@EVERY_PAGE
def test_links_of_a_page_lead_somewhere(page: Path) -> None:
    made = DOCS / "api"  # by `make docs`
    for target, anchor in links(page):
        assert target.exists() or target.is_relative_to(made), f"{target} is not there"
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), f"{target.name} has no heading #{anchor}"


@EVERY_PAGE
def test_files_and_scripts_a_page_names_are_there(page: Path) -> None:
    text = page.read_text()
    named = [file for file in OWN_FILE.findall(text) if not file.startswith(GENERATED)]
    named += [f"{script.replace('.', '/')}.py" for script in OWN_SCRIPT.findall(text)]
    assert [file for file in named if not (ROOT / file).exists()] == []


@EVERY_PAGE
def test_page_has_one_title(page: Path) -> None:
    assert len(headings(page, "#")) == 1


def test_every_page_is_in_the_sidebar_once() -> None:
    named = []
    for page in PAGES:
        for tree in re.findall(r"^```\{toctree\}\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE):
            entries = [line for line in tree.split("\n") if line and not line.startswith((":", "api/"))]
            named += [file for entry in entries for file in page.parent.glob(f"{entry}.md")]
    assert sorted([*named, DOCS / "index.md"]) == PAGES


def test_every_page_is_reached_from_the_index() -> None:
    seen, waiting = set[Path](), [DOCS / "index.md"]
    while waiting:
        page = waiting.pop()
        if page not in seen and page.suffix == ".md" and page.is_relative_to(DOCS):
            seen.add(page)
            waiting += [target for target, _ in links(page)]
    assert [page.name for page in PAGES if page not in seen] == []
