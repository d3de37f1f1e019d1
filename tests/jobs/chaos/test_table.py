from __future__ import annotations

import ast
import json
import re

import pytest

from tests.conftest import ROOT
from tests.jobs.chaos.faults import FAULTS, Fault
from tests.jobs.chaos.table import PAGE, filled, latest, table


def marked(path: str) -> dict[str, str]:
    """Return the functions of a test file with the text of their decorators."""
    tree = ast.parse((ROOT / "tests" / path).read_text())
    found = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    return {node.name: "\n".join(map(ast.unparse, node.decorator_list)) for node in found}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_every_fault_has_tests_that_are_marked_with_its_name(fault: Fault) -> None:
    for test in fault.tests:
        path, _, name = test.partition("::")
        assert f"pytest.mark.chaos({fault.name!r})" in marked(path)[name], test


def test_every_marked_test_is_in_the_table_of_faults() -> None:
    listed = {test for fault in FAULTS for test in fault.tests}
    found = {
        f"{path.relative_to(ROOT / 'tests').as_posix()}::{name}"
        for path in (ROOT / "tests").rglob("test_*.py")
        if "pytest.mark.chaos" in path.read_text() and path.name != "test_table.py"
        for name, text in marked(str(path)).items()
        if "pytest.mark.chaos" in text
    }
    assert found == listed


def test_page_lists_the_faults_and_promises_and_nothing_else() -> None:
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \|(?: [^|]*\|){6}$", PAGE.read_text(), flags=re.MULTILINE)
    assert rows[1:] == [(fault.name, fault.promise) for fault in FAULTS]


def test_table_adds_up_the_tests_of_a_fault_and_keeps_the_last_line_of_each() -> None:
    shared = {"fault": "429 storm", "exits": [0], "equal": 5, "failed": 1, "sent_twice": 0, "note": "n"}
    told = [{**shared, "test": test, "seconds": seconds} for test, seconds in (("a", 9), ("a", 1), ("b", 2))]
    lines = latest("\n".join(map(json.dumps, told)))
    assert "| 2 | 0 | 2 | 10 of 12 | 0 | n |" in table(lines)
    page = filled("before\n<!-- measured: begin -->\nold\n<!-- measured: end -->\nafter\n", lines)
    assert page == f"before\n<!-- measured: begin -->\n{table(lines)}<!-- measured: end -->\nafter\n"
