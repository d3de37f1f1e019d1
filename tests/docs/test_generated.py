"""Pages that code describes say what the code does today."""

from __future__ import annotations

import importlib.util
from types import ModuleType

import pytest

from jobs.cli import VERBS
from schemas.tables import ALL_TABLES
from tests.conftest import ROOT

DOCS = ROOT / "docs"


def load_generate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    return generate


GENERATE = load_generate()


@pytest.mark.parametrize("page", GENERATE.WRITTEN)
def test_page_is_the_generated_one(page: str) -> None:
    assert (DOCS / f"{page}.md").read_text() == GENERATE.WRITTEN[page](), "run: python docs/generate.py"


def test_every_verb_and_every_table_has_its_place() -> None:
    commands, columns = GENERATE.command_reference(), GENERATE.column_reference()
    assert [verb for verb in VERBS if f"## {verb}\n" not in commands] == []
    for name, spec in ALL_TABLES.items():
        section = columns.split(f"## {name}\n")[1].split("\n## ")[0]
        assert [column for column in spec.columns if f"| `{column}` |" not in section] == []


def test_no_column_of_a_table_is_without_a_meaning() -> None:
    assert "|  |" not in GENERATE.column_reference()
