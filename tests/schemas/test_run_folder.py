from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas import storage
from schemas.errors import InputError
from schemas.manifest import commit_unit
from schemas.plan import PLAN_FILE, encode_plan
from schemas.run_folder import RunFolder, image_name, read_table, safe_name
from tests.workers.fake_steps import POSE, answer, arm, unit


def write_run(root: Path, committed: tuple[int, ...]) -> str:
    units = [unit(i, ["a", "b"]) for i in range(4)]
    run = RunFolder(str(root))
    storage.write_bytes_atomic(run.uri(PLAN_FILE), encode_plan(units))
    run.write_run({"name": "test"})
    for index in committed:
        questions = units[index].questions
        rows = {"answers": [answer(q) for q in questions], "arms": [arm(q, "final", mark=None) for q in questions]}
        commit_unit(run.root, units[index].id, rows)
    return run.root


def test_table_is_read_in_plan_order_whatever_the_order_of_commits(tmp_path: Path) -> None:
    run = write_run(tmp_path, (3, 0, 2))
    expected = [f"scene{i}-{j}" for i in (0, 2, 3) for j in (0, 1)]
    assert list(read_table(run, "answers")["question_id"]) == expected
    assert list(read_table(Path(run), "arms")["question_id"]) == expected


def test_missing_whole_number_stays_a_whole_number_column(tmp_path: Path) -> None:
    frame = read_table(write_run(tmp_path, (0,)), "arms")
    assert frame["mark"].dtype == pd.Int32Dtype()
    assert frame["mark"].isna().all()
    assert frame["frames"].dtype == "int32"


def test_columns_are_those_asked_for_in_that_order(tmp_path: Path) -> None:
    run = write_run(tmp_path, (0, 2))
    frame = read_table(run, "arms", ["mark", "question_id"])
    assert frame.equals(read_table(run, "arms")[["mark", "question_id"]])
    with pytest.raises(InputError, match=r"table arms: expected one of question_id, .*, found marks"):
        read_table(run, "arms", ["marks"])


def test_table_without_rows_keeps_its_columns(tmp_path: Path) -> None:
    frame = read_table(write_run(tmp_path, (0,)), "regions")
    assert len(frame) == 0
    assert "gaussians" in frame.columns


def test_folder_without_a_run_and_unknown_table_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected a run folder with .*, found none"):
        read_table(tmp_path, "answers")
    with pytest.raises(InputError, match="found 'answer'"):
        read_table(write_run(tmp_path, ()), "answer")
    (tmp_path / "run.json").write_text("[1]")
    with pytest.raises(InputError, match="expected a JSON object"):
        RunFolder(str(tmp_path)).read_run()
    (tmp_path / "run.json").write_text("{")
    with pytest.raises(InputError, match="expected JSON"):
        RunFolder(str(tmp_path)).read_run()


@given(st.text())
def test_any_text_becomes_one_plain_file_name(text: str) -> None:
    name = safe_name(text)
    assert re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]*", name)
    assert len(name) < 120


@pytest.mark.parametrize("text", ["../../etc/passwd", "/root", "..", "", "a\0b", "CON:", "x" * 500, "é", ".hidden"])
def test_hostile_names_stay_inside_the_folder(tmp_path: Path, text: str) -> None:
    path = (tmp_path / image_name(text, text, POSE)).resolve()
    assert path.is_relative_to(tmp_path / "images")
    assert len(path.relative_to(tmp_path).parts) == 3


def test_names_that_look_alike_after_escaping_stay_apart() -> None:
    assert len({safe_name(text) for text in ("a/b", "a_b", "a b", "a\\b")}) == 4
    assert safe_name("frame_000.10") == "frame_000.10"


def test_same_candidate_id_at_another_pose_has_another_picture() -> None:
    moved = (*POSE[:11], POSE[11] + 1e-9)
    assert image_name("s", "f/0/left", POSE) != image_name("s", "f/0/left", moved)
