"""Every planned question in every table of scores: what has no row is pending or failed, and is counted as such."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from jobs.scoring.scores import ARMS, PENDING
from schemas.plan_columns import plan_table

PLANNED = (
    *("question_id", "scene", "scene_sha256", "method", "task", "category"),
    *("question", "answer", "target_ids"),
)
"""Columns of the plan that denominators and comparisons need."""

SCORED = (
    "question_id",
    "scene",
    "task",
    "category",
    "method",
    "arm",
    "status",
    "frames",
    "mark",
    "predicted",
    "targets",
    "iou",
    "pair_ious",
    "answer",
)
"""Columns of table `arms` that scores need."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Tables `arms` and `answers` with a row for every planned question."""

    arms: pd.DataFrame
    """Columns `SCORED`; a question that has no row in an arm gets one with the status of its answer, or pending."""
    answers: pd.DataFrame
    """Columns question_id, task, status, reference."""

    @property
    def planned(self) -> int:
        """Questions planned."""
        return len(self.answers)

    @property
    def pending(self) -> int:
        """Questions without committed rows."""
        return int((self.answers["status"] == PENDING).sum())

    def notice(self) -> str:
        """Return what stands above the scores of a run that is not complete; empty for one that is."""
        return notice(self.planned, self.pending)


def notice(planned: int, pending: int) -> str:
    """Return what stands above scores over questions of which some are pending; empty where none is."""
    if not pending:
        return ""
    return (
        f"INCOMPLETE: {planned - pending} of {planned} questions are committed; {pending} pending ones are in no mean"
    )


def read_plan(run: str | Path) -> pd.DataFrame:
    """Return the plan's questions, one row each, with the columns `PLANNED`; `answer` is called `reference`.

    Raises:
        InputError: There is no plan, or it cannot be read.
    """
    return plan_table(str(run), PLANNED).to_pandas().rename(columns={"answer": "reference"})


def with_planned(arms: pd.DataFrame, answers: pd.DataFrame, plan: pd.DataFrame) -> Coverage:
    """Return the tables with a row for every planned question.

    Args:
        arms: Table `arms`, committed rows.
        answers: Table `answers`, committed rows.
        plan: From `read_plan`.
    """
    known = plan.merge(answers[["question_id", "status"]], "left", on="question_id", validate="one_to_one")
    known["status"] = known["status"].astype(object).where(known["status"].notna(), PENDING)
    targets = zip(plan["task"], plan["target_ids"], strict=True)
    known["targets"] = [None if task == "eqa" or ids is None else len(ids) for task, ids in targets]
    # Committed rows name the method and its arms; before any, the plan and the paper do.
    names = arms[["method", "arm"]].drop_duplicates()
    if names.empty:
        names = pd.DataFrame({"method": plan["method"].iloc[0], "arm": ARMS})
    wanted = known.drop(columns="method").merge(names, "cross")
    keys = ["method", "question_id", "arm"]
    there = pd.MultiIndex.from_frame(wanted[keys]).isin(pd.MultiIndex.from_frame(arms[keys]))
    missing = wanted[~there].reindex(columns=SCORED)
    # Column by column, as objects: pandas would guess a type for what one side lacks.
    rows = {name: pd.Series([*arms[name], *missing[name]], dtype=object) for name in SCORED}
    return Coverage(pd.DataFrame(rows), known[["question_id", "task", "status", "reference"]])
