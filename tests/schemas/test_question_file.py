"""Question files: what is read back, and one clear line for everything wrong."""

from __future__ import annotations

import io
import json
import string
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.errors import InputError
from schemas.question_file import load_questions, question_at, read_lines, save_questions
from schemas.questions import TASKS, Question

GOOD = {"question_id": "q1", "scene": "flat", "task": "eqa", "question": "Where is the lamp?", "answer": "On the desk"}

words = st.text(string.ascii_letters + 'äß ,"\\\n', min_size=1).filter(str.strip)


def write(path: Path, *lines: object) -> Path:
    path.write_text("".join((line if isinstance(line, str) else json.dumps(line)) + "\n" for line in lines))
    return path


@given(
    questions=st.lists(
        st.builds(
            Question,
            question_id=words,
            scene=words,
            task=st.sampled_from(TASKS),
            question=words,
            answer=st.none() | words,
            extra_answers=st.lists(words, max_size=2).map(tuple),
            category=st.text(max_size=5),
            target_ids=st.none() | st.lists(st.integers(0, 99), max_size=3, unique=True).map(tuple),
            target_category=st.text(max_size=5),
        ),
        min_size=1,
        max_size=4,
        unique_by=lambda q: q.question_id,
    )
)
def test_save_then_load_gives_the_same_questions(questions: list[Question], tmp_path_factory: object) -> None:
    path = tmp_path_factory.mktemp("q") / "questions.jsonl"  # type: ignore[attr-defined]
    save_questions(questions, path)
    assert load_questions(path) == tuple(questions)


def test_load_skips_blank_lines_and_keeps_file_order(tmp_path: Path) -> None:
    path = write(tmp_path / "q.jsonl", GOOD | {"question_id": "b"}, "", GOOD | {"question_id": "a"}, "  ")
    assert [q.question_id for q in load_questions(str(path))] == ["b", "a"]


def test_load_keeps_the_difference_between_no_target_and_unknown_target(tmp_path: Path) -> None:
    path = write(tmp_path / "q.jsonl", GOOD | {"target_ids": []}, GOOD | {"question_id": "q2", "target_ids": None})
    assert [q.target_ids for q in load_questions(path)] == [(), None]


@pytest.mark.parametrize(
    ("bad", "field", "said"),
    [
        ({k: v for k, v in GOOD.items() if k != "scene"}, "scene", "no such field"),
        (GOOD | {"task": "vqa"}, "task", "vqa"),
        (GOOD | {"question": " "}, "question", "' '"),
        (GOOD | {"question": 3}, "question", "3"),
        (GOOD | {"answer": ["a"]}, "answer", '["a"]'),
        (GOOD | {"extra_answers": "On the desk"}, "extra_answers", "On the desk"),
        (GOOD | {"extra_answers": [1]}, "extra_answers", "[1]"),
        (GOOD | {"target_ids": [1.5]}, "target_ids", "1.5"),
        (GOOD | {"target_ids": [True]}, "target_ids", "true"),
        (GOOD | {"target_ids": [4, 4]}, "target_ids", "[4, 4]"),
        (GOOD | {"awnser": "x"}, "awnser", "that name"),
        (GOOD | {"question_id": "q0"}, "question_id", "line 1"),
    ],
)
def test_load_names_line_and_field_of_a_bad_value(tmp_path: Path, bad: object, field: str, said: str) -> None:
    path = write(tmp_path / "q.jsonl", GOOD | {"question_id": "q0"}, "", bad)
    with pytest.raises(InputError) as caught:
        load_questions(path)
    assert caught.value.field == field
    assert str(caught.value).startswith(f"{path} line 3: {field}: expected")
    assert said in caught.value.found
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("line", ["{", "[1]", "nonsense", '{"a": 1} {"b": 2}', '{"scene": "a", "scene": "b"}'])
def test_load_names_the_line_that_is_no_json_object(tmp_path: Path, line: str) -> None:
    path = write(tmp_path / "q.jsonl", GOOD, line)
    with pytest.raises(InputError, match="line 2"):
        load_questions(path)


@pytest.mark.parametrize("content", [b"", b"\n  \n"])
def test_load_refuses_an_empty_file(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "q.jsonl"
    path.write_bytes(content)
    with pytest.raises(InputError, match="an empty file"):
        load_questions(path)


def test_load_refuses_bytes_that_are_not_utf8(tmp_path: Path) -> None:
    path = tmp_path / "q.jsonl"
    path.write_bytes(json.dumps(GOOD).encode() + b"\xff")
    with pytest.raises(InputError, match="UTF-8"):
        load_questions(path)


def test_load_names_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.jsonl"):
        load_questions(tmp_path / "nowhere.jsonl")


def test_lines_are_read_one_by_one_and_again_by_their_byte(tmp_path: Path) -> None:
    texts = [json.dumps({**GOOD, "question_id": str(n), "question": "où?"}, ensure_ascii=False) for n in range(3)]
    data = ("\ufeff" + texts[0] + "\r\n\n" + texts[1] + "\nwrong\n" + texts[2]).encode()
    lines = list(read_lines(io.BytesIO(data), "f"))
    assert [line.number for line in lines] == [1, 3, 4, 5]
    assert isinstance(lines[2].question, InputError)
    for line in (lines[0], lines[1], lines[3]):
        assert question_at(io.BytesIO(data), line.offset, "f") == line.question
    with pytest.raises(InputError, match="f byte 5"):
        question_at(io.BytesIO(data), 5, "f")


@pytest.mark.parametrize(
    "line",
    ["[" * 100_000, "9" * 5_000, '{"question_id": "\\ud800", "scene": "s", "task": "eqa", "question": "q"}'],
    ids=["deep", "long number", "half a pair"],
)
def test_hostile_line_is_an_input_error(line: str) -> None:
    (found,) = read_lines(io.BytesIO(line.encode()), "f")
    assert isinstance(found.question, InputError)
