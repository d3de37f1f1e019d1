"""The index on disk against lists in memory."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jobs.question_index import QuestionIndex
from jobs.runs.problems import Problems
from schemas.errors import InputError
from schemas.question_file import save_questions
from schemas.questions import TASKS, Question

SCENES = ("b", "a", "é c")


def question(number: int, name: int, scene: int, task: int) -> Question:
    return Question(f"id {name}", (*SCENES, "other")[scene], TASKS[task], f"question {number} ?", answer="ü" * number)


DRAWN = st.lists(st.tuples(st.integers(0, 40), st.integers(0, 3), st.integers(0, 2)), min_size=1, max_size=12)


@settings(max_examples=60, deadline=None)
@given(files=st.lists(DRAWN, min_size=1, max_size=3), limit=st.none() | st.integers(1, 3))
def test_index_gives_what_lists_would_give(files: list[list[tuple[int, int, int]]], limit: int | None) -> None:
    given_questions = [[question(n, *values) for n, values in enumerate(file)] for file in files]
    index, problems = QuestionIndex(SCENES, ("eqa", "ground_one"), limit, refuse_others=False), Problems()
    with tempfile.TemporaryDirectory() as folder:
        for number, questions in enumerate(given_questions):
            path = Path(folder, f"{number}.jsonl")
            save_questions(questions, path)
            index.read(str(path), problems)
        problems.refuse()
        index.find_repeated(problems)
        found = dict(index.by_scene())
    flat = [q for questions in given_questions for q in questions]
    kept = {name: tuple(q for q in flat if q.scene == name and q.task != "ground_many")[:limit] for name in SCENES}
    assert found == {name: own for name, own in kept.items() if own}
    assert list(found) == [name for name in SCENES if kept[name]]
    assert index.kept == sum(len(own) for own in kept.values())
    repeated = len(flat) - len({q.question_id for q in flat})
    if repeated:
        with pytest.raises(InputError, match="question_id: expected an id no other question has") as caught:
            problems.refuse()
        assert len(getattr(caught.value, "__notes__", ())) == repeated - 1
    else:
        problems.refuse()


def test_each_repeat_names_both_lines(tmp_path: Path) -> None:
    index, problems = QuestionIndex(SCENES, TASKS, None, refuse_others=True), Problems()
    first, second = tmp_path / "1.jsonl", tmp_path / "2.jsonl"
    save_questions([question(0, 1, 0, 0), question(1, 2, 1, 0)], first)
    save_questions([question(0, 3, 0, 0), question(1, 2, 0, 0), question(2, 2, 1, 0)], second)
    index.read(str(first), problems)
    index.read(str(second), problems)
    index.find_repeated(problems)
    with pytest.raises(InputError) as caught:
        problems.refuse()
    said = "question_id: expected an id no other question has, found 'id 2', also in"
    assert [str(caught.value), *caught.value.__notes__] == [
        f"{second} line 2: {said} {first} line 2",
        f"{second} line 3: {said} {second} line 2",
    ]
