"""Functions and modules that pages name are there, and docs/paper.md has one for every equation of the paper."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from jobs.builds.build_job import BuildWorkers
from jobs.config import WorkersConfig
from tests.conftest import ROOT, SHARED

PAGE = (ROOT / "docs" / "paper.md").read_text()
PAGES = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
TEXT = "\n".join(page.read_text() for page in PAGES)
FIELDS = {f"workers.{name}" for name in {**WorkersConfig.model_fields, **BuildWorkers.model_fields}}
"""Of a section of job files, which is called like the package."""
NAMES = sorted(set(re.findall(r"`((?:pipeline|jobs|schemas|workers)\.[\w.]+)`", TEXT)) - FIELDS)
PAPER = SHARED.parent / "seed" / "splatreasoner.tex"


@pytest.mark.parametrize("name", NAMES)
def test_name_on_a_page_exists(name: str) -> None:
    # Read, not imported: torch alone would take seconds.
    place, names = _module_of(name.split("."))
    node: ast.AST = ast.parse(place.read_text())
    for one in names:
        found = [child for child in ast.iter_child_nodes(node) if one in _defined(child)]
        assert found, f"{place.relative_to(ROOT)} has no {one}"
        node = found[0]


def _module_of(parts: list[str]) -> tuple[Path, list[str]]:
    """The file of the module that a dotted name begins with, and what is named in it."""
    for last in range(len(parts), 0, -1):
        stem = ROOT.joinpath(*parts[:last])
        for place in (stem.with_suffix(".py"), stem / "__init__.py"):
            if place.is_file():
                return place, parts[last:]
    raise AssertionError(f"no module in {parts}")


def _defined(node: ast.AST) -> list[str]:
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.Assign | ast.AnnAssign):
        return [target.id for target in ast.walk(node) if isinstance(target, ast.Name)]
    return [alias.asname or alias.name for alias in node.names] if isinstance(node, ast.ImportFrom) else []


def test_every_equation_has_a_row() -> None:
    if not PAPER.is_file():
        pytest.skip(f"the paper is not at {PAPER}")
    main, supplement = PAPER.read_text().split(r"\appendix")
    rows = set(re.findall(r"eq\. (S?\d+)", PAGE))
    wanted = {str(n + 1) for n in range(main.count(r"\begin{equation}"))}
    wanted |= {f"S{n + 1}" for n in range(supplement.count(r"\begin{equation}"))}
    assert rows == wanted
