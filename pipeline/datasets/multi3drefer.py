"""Multi3DRefer: descriptions of no, one or several objects of a ScanNet scan.

`eval_type` tells the target count and whether the scene holds distractors (other objects of the target's class):
zt_w_d, zt_wo_d, st_w_d, st_wo_d, mt. Object ids are the scan's 0-based objectId.
"""

from __future__ import annotations

from collections import Counter

from pipeline.datasets.json_items import Item, read_items
from schemas.errors import InputError
from schemas.questions import Question

EVAL_TYPES = ("zt_w_d", "zt_wo_d", "st_w_d", "st_wo_d", "mt")
SUBSETS = ("all", "zt", "st", *EVAL_TYPES)
"""zt and st take both of theirs, with and without distractors."""
_TARGETS = {"zt": (0, 0), "st": (1, 1), "mt": (2, 10**6)}
"""Fewest and most targets."""


def load_multi3drefer(path: str, subset: str = "all") -> tuple[Question, ...]:
    """Return Multi3DRefer's questions, in file order; `category` is the eval_type.

    Args:
        path: multi3drefer_val.json.
        subset: One of `SUBSETS`, as `load_dataset_questions` checks.

    Raises:
        InputError: The file is wrong, a question repeats, or the number of targets is not what eval_type says.
    """
    questions = tuple(_question(item) for item in read_items(path))
    repeated = [name for name, count in Counter(q.question_id for q in questions).items() if count > 1]
    if repeated:
        found = f"{repeated[0]} twice"
        raise InputError(path, field="ann_id", expected="each scene and ann_id once", found=found)
    return tuple(q for q in questions if subset in ("all", q.category, q.category.split("_")[0]))


def _question(item: Item) -> Question:
    scene, kind, targets = item.text("scene_id"), item.one_of("eval_type", EVAL_TYPES), item.integers("object_ids")
    fewest, most = _TARGETS[kind.split("_")[0]]
    if not fewest <= len(targets) <= most:
        expected = f"{fewest} targets for {kind}" if fewest == most else f"{fewest} targets or more for {kind}"
        raise item.error("object_ids", expected)
    return Question(
        question_id=f"{scene}-{item.integer('ann_id')}",
        scene=scene,
        task="ground_many",
        question=item.text("description"),
        category=kind,
        target_ids=targets,
        target_category=item.text("object_name").replace("_", " "),
    )
