"""OpenEQA's question file: counts of the real one, strictness on made ones."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from pipeline.datasets import SUBSETS, load_dataset_questions
from pipeline.datasets.openeqa import CATEGORIES
from schemas.errors import InputError
from schemas.question_file import load_questions, save_questions
from schemas.questions import Question

ITEM: dict[str, Any] = {
    "question": "What is on the desk?",
    "answer": "A lamp",
    "category": "object recognition",
    "question_id": "a",
    "episode_history": "scannet-v0/002-scannet-scene0709_00",
}


def write(folder: Path, items: Any, name: str = "open-eqa-v0.json") -> str:
    (folder / name).write_text(items if isinstance(items, str) else json.dumps(items))
    return str(folder / name)


@pytest.fixture
def official(shared_data: Path) -> str:
    return str(shared_data / "openeqa/open-eqa-v0.json")


def load(path: str, subset: str = "all") -> tuple[Question, ...]:
    return load_dataset_questions("openeqa", path, subset)


@pytest.mark.parametrize(
    ("subset", "count"),
    [("all", 1636), ("scannet", 1079), ("hm3d", 557), ("3dmem-1623", 1623), ("aeqa-184", 184), ("aeqa-41", 41)],
)
def test_official_subsets_have_their_counts(official: str, subset: str, count: int) -> None:
    questions = load(official, subset)
    assert len(questions) == len({q.question_id for q in questions}) == count
    assert subset in SUBSETS["openeqa"]


def test_official_file_has_its_categories_extra_answers_and_episodes(official: str) -> None:
    questions = load(official)
    assert Counter(q.category for q in questions) == {
        "object localization": 263,
        "object state recognition": 252,
        "attribute recognition": 240,
        "object recognition": 231,
        "spatial understanding": 220,
        "functional reasoning": 217,
        "world knowledge": 213,
    }
    extra = [q for q in questions if q.extra_answers]
    assert {q.category for q in extra} == {"object localization"}
    # One of the official extra answers is blank.
    assert Counter(len(q.extra_answers) for q in extra) == {4: 262, 3: 1}
    assert len({q.scene for q in questions}) == 152


def test_3dmem_subset_lacks_one_scan_and_nothing_else(official: str) -> None:
    left_out = {q.scene for q in load(official)} - {q.scene for q in load(official, "3dmem-1623")}
    assert [scene.rsplit("-", 1)[-1] for scene in left_out] == ["scene0648_01"]


def test_both_lists_of_184_name_the_same_questions_all_of_hm3d(official: str, shared_data: Path) -> None:
    questions = load(official, "aeqa-184")
    other = str(shared_data / "openeqa/aeqa_questions-184.json")
    assert load_dataset_questions("openeqa", official, "aeqa-184", subset_file=other) == questions
    assert all("-hm3d-" in q.scene for q in questions)


def test_official_questions_survive_our_own_format(official: str, tmp_path: Path) -> None:
    questions = load(official)
    save_questions(questions, tmp_path / "q.jsonl")
    assert load_questions(tmp_path / "q.jsonl") == questions
    assert load_dataset_questions("jsonl", str(tmp_path / "q.jsonl")) == questions


def test_aeqa_items_load_by_themselves(shared_data: Path) -> None:
    questions = load(str(shared_data / "openeqa/aeqa_questions-41.json"))
    assert len(questions) == 41
    assert questions[0].scene == "00824-Dd4bFSTQ8gi"


def test_an_item_becomes_a_question(tmp_path: Path) -> None:
    extra = {**ITEM, "question_id": "b", "extra_answers": ["On it", " ", "Above"], "category": CATEGORIES[1]}
    first, second = load(write(tmp_path, [ITEM, extra]))
    assert first == Question(
        "a", "002-scannet-scene0709_00", "eqa", "What is on the desk?", "A lamp", (), "object recognition"
    )
    assert second.extra_answers == ("On it", "Above")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"question": ""}, 'item 0: question: expected a text that is not empty, found ""'),
        ({"answer": 3}, "item 0: answer: .* found 3"),
        ({"category": "colour"}, "item 0: category: expected one of object recognition"),
        ({"extra_answers": "one"}, "item 0: extra_answers: expected a list of texts"),
        ({"episode_history": None}, "item 0: episode_history: .* found null"),
        ({"question_id": 7}, "item 0: question_id"),
    ],
)
def test_a_wrong_field_is_named_with_file_and_item(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=rf"open-eqa-v0\.json {message}"):
        load(write(tmp_path, [{**ITEM, **change}]))


@pytest.mark.parametrize("name", sorted(ITEM))
def test_a_missing_field_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"item 1: {name}: .* found no such field"):
        load(write(tmp_path, [ITEM, {k: v for k, v in ITEM.items() if k != name} | {"x": 1}]))


def test_a_repeated_id_names_both_items(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"item 2: question_id: expected an id of its own, not that of .* item 0"):
        load(write(tmp_path, [ITEM, {**ITEM, "question_id": "b"}, ITEM]))


@pytest.mark.parametrize("text", ["", "{}", "[]", "[1]", "not json", "[" * 100_000])
def test_what_is_no_list_of_items_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match=r"open-eqa-v0\.json"):
        load(write(tmp_path, text))


def test_a_known_subset_of_another_file_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, [ITEM])
    with pytest.raises(InputError, match=r"subset scannet: expected 1079 questions, found 1"):
        load(path, "scannet")
    with pytest.raises(InputError, match=r"subset_file: expected a path, or open-eqa-v0-184-questions\.json or"):
        load(path, "aeqa-184")
    write(tmp_path, ["a", "b"], "aeqa_questions-41.json")
    with pytest.raises(InputError, match=r"aeqa-41: question_id: expected ids of .* found 1 others; first: b"):
        load(path, "aeqa-41")
    write(tmp_path, ["a", 3], "aeqa_questions-41.json")
    with pytest.raises(InputError, match="item 1: expected a question id"):
        load(path, "aeqa-41")


def test_unknown_kinds_and_subsets_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path, [ITEM])
    with pytest.raises(InputError, match="openeqa: subset: expected one of all, 3dmem-1623"):
        load(path, "half")
    with pytest.raises(InputError, match=r"missing\.json"):
        load(str(tmp_path / "missing.json"))
