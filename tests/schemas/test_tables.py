from __future__ import annotations

import dataclasses
import types
import typing
from typing import Any, Literal, Union

import pytest

from schemas.answers import ANSWERS, ARMS, ArmRow
from schemas.build_plan import BUILD_PLAN
from schemas.errors import InputError
from schemas.plan import PLAN
from schemas.table import TableSpec
from schemas.tables import ALL_TABLES, SAME_EVERY_RUN, TABLES, table_spec
from tests.workers.fake_steps import answer, arm, unit

EVERY = [*ALL_TABLES.values(), PLAN, BUILD_PLAN]
QUESTION = unit(0, ["q"]).questions[0]


def notations(hint: Any) -> set[str]:
    """The column types that may hold a record field of this type hint."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (Union, types.UnionType):
        (kept,) = [a for a in arguments if a is not type(None)]
        return {f"{text}?" for text in notations(kept)}
    if origin is tuple:
        return {f"list<{text}>" for text in notations(arguments[0])}
    if origin is Literal:
        return {"string"}
    return {str: {"string"}, int: {"int32", "int64"}, float: {"float64"}, bool: {"bool"}}[hint]


@pytest.mark.parametrize("spec", EVERY, ids=lambda spec: spec.name)
def test_schema_has_the_types_of_the_record(spec: TableSpec[Any]) -> None:
    hints = typing.get_type_hints(spec.record)
    assert list(hints) == list(spec.columns) == spec.arrow_schema().names
    for name, notation in spec.columns.items():
        assert notation in notations(hints[name]), f"{spec.name}.{name}"
    assert set(spec.key) <= set(spec.columns)


@pytest.mark.parametrize("spec", EVERY, ids=lambda spec: spec.name)
def test_empty_table_keeps_its_schema(spec: TableSpec[Any]) -> None:
    table = spec.to_arrow([])
    spec.check(table.schema, "here")
    assert spec.to_rows(table) == []


def test_rows_come_back_from_arrow_as_they_were() -> None:
    rows = [
        arm(QUESTION, "initial"),
        arm(QUESTION, "final", mark=None, iou=0.25, views=(), chosen=(2, 0), region_gaussians=1 << 40),
    ]
    assert ARMS.to_rows(ARMS.to_arrow(rows)) == rows


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reason": None}, "column reason has 1 nulls"),
        ({"frames": "three"}, "column frames"),
        ({"evidence": ("chair", None)}, "column evidence"),
        ({"frames": 1 << 31}, "column frames"),
    ],
)
def test_value_that_a_column_does_not_hold_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ANSWERS.to_arrow([answer(QUESTION, **changes)])


def test_table_of_another_name_version_or_column_is_refused() -> None:
    newer = dataclasses.replace(ANSWERS, version=ANSWERS.version + 1)
    expected = f"part: version: expected 1 to {ANSWERS.version}, found {newer.version} .written by a newer"
    with pytest.raises(InputError, match=expected):
        ANSWERS.check(newer.arrow_schema(), "part")
    with pytest.raises(InputError, match="part: table: expected answers, found arms"):
        ANSWERS.check(ARMS.arrow_schema(), "part")
    wider = dataclasses.replace(ANSWERS, columns={**ANSWERS.columns, "frames": "int64"})
    with pytest.raises(InputError, match="part: frames"):
        ANSWERS.check(wider.arrow_schema(), "part")


def test_columns_that_differ_from_the_record_are_refused() -> None:
    with pytest.raises(ValueError, match="differ from record fields"):
        TableSpec("arms", 1, ArmRow, {"question_id": "string"}, ("question_id",))
    with pytest.raises(ValueError, match="unknown type 'text'"):
        dataclasses.replace(ANSWERS, columns={**ANSWERS.columns, "answer": "text"})


def test_tables_are_known_by_name() -> None:
    assert table_spec("answers") is ANSWERS
    assert set(SAME_EVERY_RUN) <= set(TABLES)
    with pytest.raises(InputError, match="expected one of answers, arms"):
        table_spec("answer")
