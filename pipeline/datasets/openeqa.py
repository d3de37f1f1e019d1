"""OpenEQA (EM-EQA): `open-eqa-v0.json`, both halves, and the subsets other papers report on.

An item's `episode_history`, such as "scannet-v0/002-scannet-scene0709_00", is the folder of its frames; its last part
names the scene, since OpenEQA's episode is only the beginning of a ScanNet scan. `extra_answers` exist on the 263
object localization items.
"""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.datasets.json_items import Item, read_items, read_list
from pipeline.scene.questions import EQA_MAKERS
from schemas.errors import InputError
from schemas.questions import Question
from schemas.storage import exists, join

CATEGORIES = tuple(EQA_MAKERS)
"""The seven categories, by their official names."""
LEFT_OUT_BY_3DMEM = "scene0648_01"
"""The scan 3D-Mem, and so the paper, has no frames of: 13 questions."""


@dataclass(frozen=True, slots=True)
class _Listed:
    """A subset given by a list of question ids."""

    count: int
    files: tuple[str, ...]
    """Names under which the list is known, official first."""


LISTED = {
    "aeqa-184": _Listed(184, ("open-eqa-v0-184-questions.json", "aeqa_questions-184.json")),
    "aeqa-41": _Listed(41, ("aeqa_questions-41.json",)),
}
"""Subsets whose ids lie in a file. Of the 41 questions 25 are not among the 184."""
WHOLE = {"all": 1636, "3dmem-1623": 1623, "hm3d": 557, "scannet": 1079}
"""Subsets that follow from the question file alone, and how many questions they have."""
SUBSETS = (*WHOLE, *LISTED)


def load_openeqa(path: str, subset: str = "all", subset_file: str | None = None) -> tuple[Question, ...]:
    """Return OpenEQA's questions, in file order.

    Args:
        path: open-eqa-v0.json. A file with other items of the same form is read the same way, as "all".
        subset: One of `SUBSETS`, as `load_dataset_questions` checks.
        subset_file: The list of aeqa-184 or aeqa-41: question ids, or items with a question_id. None looks beside the
            question file under the official names.

    Raises:
        InputError: A file is missing or wrong, an id repeats or is listed and not there, or a named subset other than
            "all" has not the number of questions it is known for.
    """
    items = read_items(path)
    questions = tuple(_question(item) for item in items)
    _require_distinct(items, questions)
    if subset in LISTED:
        listed = _listed_ids(path, subset, subset_file)
        unknown = sorted(listed - {q.question_id for q in questions})
        if unknown:
            found = f"{len(unknown)} others; first: {unknown[0]}"
            raise InputError(subset_file or subset, field="question_id", expected=f"ids of {path}", found=found)
        questions = tuple(q for q in questions if q.question_id in listed)
    elif subset == "3dmem-1623":
        questions = tuple(q for q in questions if not q.scene.endswith(LEFT_OUT_BY_3DMEM))
    elif subset != "all":
        questions = tuple(q for q in questions if f"-{subset}-" in q.scene)
    expected = {**WHOLE, **{name: listed.count for name, listed in LISTED.items()}}[subset]
    if subset != "all" and len(questions) != expected:
        raise InputError(path, field=f"subset {subset}", expected=f"{expected} questions", found=len(questions))
    return questions


def _question(item: Item) -> Question:
    return Question(
        question_id=item.text("question_id"),
        scene=item.text("episode_history").rstrip("/").split("/")[-1],
        task="eqa",
        question=item.text("question"),
        answer=item.text("answer"),
        extra_answers=item.texts("extra_answers"),
        category=item.one_of("category", CATEGORIES),
    )


def _require_distinct(items: tuple[Item, ...], questions: tuple[Question, ...]) -> None:
    seen: dict[str, str] = {}
    for item, question in zip(items, questions, strict=True):
        if question.question_id in seen:
            raise item.error("question_id", f"an id of its own, not that of {seen[question.question_id]}")
        seen[question.question_id] = item.subject


def _listed_ids(path: str, subset: str, subset_file: str | None) -> frozenset[str]:
    """Return the ids of a list file: texts, or objects with a question_id."""
    if subset_file is None:
        folder = path.rsplit("/", 1)[0] if "/" in path else "."
        beside = (join(folder, name) for name in LISTED[subset].files)
        subset_file = next((at for at in beside if exists(at)), None)
        if subset_file is None:
            expected = f"a path, or {' or '.join(LISTED[subset].files)} beside the question file"
            raise InputError("openeqa", field="subset_file", expected=expected, found="neither")
    ids = []
    for i, entry in enumerate(read_list(subset_file)):
        value = entry.get("question_id") if isinstance(entry, dict) else entry
        if not isinstance(value, str):
            found = type(entry).__name__
            raise InputError(f"{subset_file} item {i}", expected="a question id, or an item with one", found=found)
        ids.append(value)
    return frozenset(ids)
