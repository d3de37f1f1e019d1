"""Question files of every dataset to `Question` records, by the dataset's name."""

from __future__ import annotations

from typing import Literal, get_args

from pipeline.datasets import multi3drefer, openeqa, referring, scanrefer
from schemas.errors import InputError
from schemas.question_file import load_questions
from schemas.questions import Question

DatasetKind = Literal["openeqa", "scanrefer", "multi3drefer", "referring", "jsonl"]
"""openeqa, scanrefer and multi3drefer in their official formats; referring segmentation and anything else as JSONL."""

DATASET_KINDS: tuple[DatasetKind, ...] = get_args(DatasetKind)

SUBSETS: dict[DatasetKind, tuple[str, ...]] = {
    "openeqa": openeqa.SUBSETS,
    "scanrefer": scanrefer.SUBSETS,
    "multi3drefer": multi3drefer.SUBSETS,
    "referring": ("all",),
    "jsonl": ("all",),
}
"""Subsets by name; for jsonl and referring files the job's own filters do."""


def load_dataset_questions(
    kind: DatasetKind,
    path: str,
    subset: str = "all",
    *,
    subset_file: str | None = None,
    labels: str | None = None,
    objects: str | None = None,
) -> tuple[Question, ...]:
    """Return a dataset's questions, in file order.

    Args:
        kind: Which dataset, and so which format.
        path: Its question file, a path or URI.
        subset: One of `SUBSETS[kind]`.
        subset_file: OpenEQA's list of a listed subset; None looks beside the question file.
        labels: ScanNet's label table, for ScanRefer's unique and multiple; None looks beside the question file.
        objects: Object names of a ScanRefer file that has none; None looks beside the question file.

    Raises:
        InputError: The kind or the subset is unknown, or a file is missing or wrong; the message names file, item and
            field.
        RetryError: A remote store failed to answer.
    """
    if kind not in DATASET_KINDS:
        raise InputError("dataset", field="kind", expected=f"one of {', '.join(DATASET_KINDS)}", found=kind)
    if subset not in SUBSETS[kind]:
        raise InputError(kind, field="subset", expected=f"one of {', '.join(SUBSETS[kind])}", found=subset)
    path = str(path)
    if kind == "openeqa":
        return openeqa.load_openeqa(path, subset, subset_file)
    if kind == "scanrefer":
        return scanrefer.load_scanrefer(path, subset, labels, objects)
    if kind == "multi3drefer":
        return multi3drefer.load_multi3drefer(path, subset)
    return load_questions(path) if kind == "jsonl" else referring.load_referring(path)
