from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schemas import plan as plan_module
from schemas.answers import ANSWERS
from schemas.errors import InputError
from schemas.parts import encode_part
from schemas.plan import PlannedUnit, encode_plan, iter_plan, write_plan
from schemas.questions import Question
from tests.workers.fake_steps import unit

characters = st.characters(exclude_categories=["Cs"])
texts = st.text(characters, min_size=1, max_size=20).filter(lambda text: bool(text.strip()))
questions = st.builds(
    Question,
    question_id=texts,
    scene=texts,
    task=st.sampled_from(["eqa", "ground_one", "ground_many"]),
    question=texts,
    answer=st.none() | texts,
    extra_answers=st.lists(texts, max_size=2).map(tuple),
    category=st.just("") | texts,
    target_ids=st.none() | st.lists(st.integers(0, 2**40), max_size=3).map(tuple),
)


@settings(max_examples=40, deadline=None)
@given(chunks=st.lists(st.lists(questions, min_size=1, max_size=4), min_size=1, max_size=4))
def test_plan_reads_back_as_it_was_written(
    chunks: list[list[Question]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    units = [
        PlannedUnit(f"id{i}", i, chunk[0].scene, "/scenes/a b", "f" * 64, "splatreasoner", tuple(chunk))
        for i, chunk in enumerate(chunks)
    ]
    path = tmp_path_factory.mktemp("plan") / "plan.parquet"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan_module, "ROW_GROUP_ROWS", 3)
        path.write_bytes(encode_plan(units))
    assert list(iter_plan(path)) == units


def test_plan_is_the_same_bytes_every_time() -> None:
    units = [unit(i, ["a", "b"]) for i in range(3)]
    assert encode_plan(units) == encode_plan(units)


def test_units_are_read_as_they_are_needed(tmp_path: Path) -> None:
    path = tmp_path / "plan.parquet"
    path.write_bytes(encode_plan([unit(i, ["a", "b"]) for i in range(5)]))
    assert next(iter(iter_plan(path))).id == "unit0"


def test_table_that_is_no_plan_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.parquet"
    path.write_bytes(encode_part(ANSWERS, []))
    with pytest.raises(InputError, match=r"plan.parquet: table: expected plan, found answers"):
        list(iter_plan(path))


def test_written_plan_says_what_it_holds_and_reads_back(tmp_path: Path) -> None:
    units = [unit(i, ["a", "b"]) for i in range(3_000)]
    path = tmp_path / "plan.parquet"
    written = write_plan(str(path), iter(units))
    assert (written.units, written.questions) == (3_000, 6_000)
    assert written.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert list(iter_plan(path)) == units
    assert write_plan(str(tmp_path / "again.parquet"), units).sha256 == written.sha256


def test_plan_whose_units_end_in_an_error_is_not_written(tmp_path: Path) -> None:
    def units() -> Iterator[PlannedUnit]:
        yield unit(0, ["a"])
        raise InputError("scene", expected="a scene", found="none")

    with pytest.raises(InputError):
        write_plan(str(tmp_path / "plan.parquet"), units())
    assert list(tmp_path.iterdir()) == []


def test_unit_id_that_could_be_a_path_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.parquet"
    write_plan(str(path), [dataclasses.replace(unit(0, ["a"]), id="../../x")])
    with pytest.raises(InputError, match="letters, digits"):
        list(iter_plan(path))
