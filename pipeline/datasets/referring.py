"""Referring segmentation files: JSON Lines of scene, question and target instance ids.

The paper's set has question-form queries whose target must be told from others of its category (supplement, "3D
Referring Segmentation Dataset Curation"); `curate.py` makes such sets.
"""

from __future__ import annotations

import json
from collections import Counter

from pipeline.datasets.json_items import Item
from schemas.errors import InputError
from schemas.questions import TASKS, Question
from schemas.storage import read_bytes

CATEGORY = "referring"
FIELDS = ("scene", "question", "target_ids", "question_id", "task", "category", "target_category")
"""The first three are needed; ids not given count the questions of a scene."""


def load_referring(path: str) -> tuple[Question, ...]:
    """Return the questions of a referring segmentation file, in file order.

    The task follows from the number of targets where a line does not give it: one, or several.

    Raises:
        InputError: The file is missing, empty or not UTF-8; a line is no JSON object, lacks a field, has an unknown or
            wrong one, or repeats an id.
    """
    try:
        lines = read_bytes(path).decode("utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        raise InputError(path, expected="UTF-8 text", found=f"byte {error.start} that is not") from error
    counts: Counter[str] = Counter()
    questions: dict[str, Question] = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        item = _item(line, f"{path} line {number}")
        scene, targets = item.text("scene"), item.integers("target_ids")
        if not targets:
            raise item.error("target_ids", "at least one instance id")
        question_id = item.text("question_id") if item.has("question_id") else f"{scene}-{CATEGORY}-{counts[scene]:03d}"
        counts[scene] += 1
        if question_id in questions:
            raise InputError(item.subject, field="question_id", expected="an id no other line has", found=question_id)
        task = item.one_of("task", TASKS[1:]) if item.has("task") else ("ground_one", "ground_many")[len(targets) > 1]
        questions[question_id] = Question(
            question_id=question_id,
            scene=scene,
            task="ground_one" if task == "ground_one" else "ground_many",
            question=item.text("question"),
            category=item.text("category") if item.has("category") else CATEGORY,
            target_ids=targets,
            target_category=item.text("target_category") if item.has("target_category") else "",
        )
    if not questions:
        raise InputError(path, expected="at least one question, one JSON object a line", found="an empty file")
    return tuple(questions.values())


def _item(line: str, subject: str) -> Item:
    try:
        record = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(subject, expected="a JSON object on one line", found=error) from error
    if not isinstance(record, dict):
        raise InputError(subject, expected="a JSON object", found=type(record).__name__)
    unknown = sorted(set(record) - set(FIELDS))
    if unknown:
        raise InputError(
            subject, field=unknown[0], expected=f"one of the fields {', '.join(FIELDS)}", found="that name"
        )
    return Item(subject, record)
