"""The answers of a run as files for other programs: OpenEQA's results and metrics, CSV, JSON Lines.

A question without an answer never gets one here. CSV and JSON Lines have its row with its status and an empty answer.
OpenEQA's results have null: its tool wants an entry for every question, asks no judge for null and scores it 0, as it
does a mark of 0 or 1. Questions that are not committed yet are in no file, so that its tool refuses the file of a run
that is not complete. All of them are listed in a note beside the file.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from jobs.frame_text import to_csv, to_records
from jobs.scoring.coverage import read_plan
from jobs.scoring.scores import ARMS, PENDING, in_order
from schemas import storage
from schemas.errors import InputError
from schemas.run_folder import RunFolder, read_table

DEFAULT_ARM = "verified"
"""The method's answer."""

ASKED = ("question_id", "scene", "task", "category", "question", "reference")
ENDED = ("status", "reason", "answer", "mark", "iou", "predicted", "targets", "frames", "views")
COLUMNS = (*ASKED, "arm", *ENDED)
"""Columns of CSV and JSON Lines: what was asked, and how it ended in an arm."""

_BREAKS = {ord(sign): f"\\u{ord(sign):04x}" for sign in "\x85\u2028\u2029"}
"""Signs that JSON takes as they are and that many readers take for the end of a line."""

Format = Literal["openeqa", "csv", "jsonl"]
"""What is written."""


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written."""

    files: tuple[str, ...]
    """Files, the answers first."""
    planned: int
    """Questions planned, of the tasks that the format knows."""
    answered: int
    """Questions with an answer."""
    scored: int
    """Questions with a mark or an IoU."""
    unanswered: int
    """Questions ended without an answer: failed, unparsed, skipped."""
    pending: int
    """Questions not committed."""


def export_run(run: str | Path, form: Format, output: str | Path, *, arm: str = DEFAULT_ARM) -> Exported:
    """Write one arm's answers of a run.

    Args:
        run: Run folder, a path or URI.
        form: OpenEQA writes `output` (`[{question_id, answer}]`) and, beside it, the marks as `...-metrics.json`
            (`{question_id: mark}`), of `eqa` questions only; the others one row a question.
        output: File to write, a path or URI; files beside it begin with its name.
        arm: Whose answers.

    Raises:
        InputError: There is no such run or arm, a part is damaged, no question is committed, none is `eqa` for OpenEQA,
            or the file cannot be written.
    """
    rows = answer_rows(run, arm)
    if form == "openeqa":
        rows = rows[rows["task"] == "eqa"]
        if rows.empty:
            raise InputError(run, expected="eqa questions, the only ones OpenEQA has", found="none")
    committed = rows[rows["status"] != PENDING]
    answered = committed["status"] == "answered"
    target = str(output)
    written = {target: _content(committed, form)}
    if form == "openeqa":
        written[_beside(target, "-metrics.json")] = _json(
            {row["question_id"]: row["mark"] for row in to_records(committed) if row["mark"] is not None}
        )
    left = rows[rows["status"] != "answered"]
    note = _beside(target, "-unanswered.txt")
    if len(left):
        written[note] = _note(run, arm, form, rows, left)
    else:
        storage.remove(note)  # of an earlier export, when the run was not complete
    for name, content in written.items():
        storage.write_bytes_atomic(name, content.encode("utf-8", "replace"))
    return Exported(
        tuple(written),
        len(rows),
        int(answered.sum()),
        int((committed["mark"].notna() | committed["iou"].notna()).sum()),
        int((~answered).sum()),
        len(rows) - len(committed),
    )


def answer_rows(run: str | Path, arm: str = DEFAULT_ARM) -> pd.DataFrame:
    """Return one row a planned question, in plan order, with the columns `COLUMNS`; status is pending without a row.

    An answer is null unless its status is answered.

    Raises:
        InputError: There is no such run or arm, a part is damaged, or no question is committed.
    """
    RunFolder(str(run)).read_run()
    plan, arms, answers = read_plan(run), read_table(run, "arms"), read_table(run, "answers")
    if answers.empty:
        raise InputError(run, expected="a run with committed questions", found="none: resume it first")
    names = in_order(arms["arm"], ARMS) or [*ARMS]
    if arm not in names:
        raise InputError(run, field="arm", expected=f"one of {', '.join(names)}", found=arm)
    own = arms.loc[arms["arm"] == arm, ["question_id", *ENDED]]
    # A question that failed before it had arms has its status in answers alone.
    others = answers[~answers["question_id"].isin(own["question_id"])]
    both = ("question_id", "status", "reason")
    lacking = [None] * len(others)
    rows = pd.DataFrame(
        {
            name: pd.Series([*own[name], *(others[name] if name in both else lacking)], dtype=object)
            for name in ("question_id", *ENDED)
        }
    )
    found = plan.drop(columns="method").merge(rows, "left", on="question_id", validate="one_to_one").assign(arm=arm)
    found["status"] = found["status"].where(found["status"].notna(), PENDING)
    found["answer"] = found["answer"].where(found["status"] == "answered", None)
    return found[list(COLUMNS)]


def _content(rows: pd.DataFrame, form: Format) -> str:
    if form == "csv":
        return to_csv(rows.assign(views=[" ".join(v) if isinstance(v, list | tuple) else v for v in _listed(rows)]))
    if form == "jsonl":
        lines = (json.dumps(record, ensure_ascii=False).translate(_BREAKS) for record in to_records(rows))
        return "".join(line + "\n" for line in lines)
    return _json([{"question_id": row["question_id"], "answer": row["answer"]} for row in to_records(rows)])


def _listed(rows: pd.DataFrame) -> list[Any]:
    return [row["views"] for row in to_records(rows[["views"]])]


def _json(content: Any) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _note(run: str | Path, arm: str, form: Format, rows: pd.DataFrame, left: pd.DataFrame) -> str:
    """Return the list of questions without an answer, with what the file has in their place."""
    place = "null, which OpenEQA's tool scores 0" if form == "openeqa" else "an empty answer"
    counts = ", ".join(f"{count} {status}" for status, count in left["status"].value_counts().items())
    lines = [
        f"# {len(left)} of {len(rows)} questions of {run}, arm {arm}, have no answer: {counts}",
        f"# The file has {place}, for each of them; pending ones are not in it: resume the run, then export again.",
        *(f"{q}\t{status}\t{_line(reason)}" for q, status, reason in left[["question_id", "status", "reason"]].values),
    ]
    return "\n".join(lines) + "\n"


def _line(reason: object) -> str:
    return " ".join(reason.split()) if isinstance(reason, str) else ""


def _beside(target: str, ending: str) -> str:
    """Return a name beside a file: its own, with another ending."""
    head, slash, name = target.rpartition("/")
    stem = name.rpartition(".")[0] or name
    return f"{head}{slash}{stem}{ending}"
