"""Metrics as people read them: the same rows and words in the terminal and in the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pandas as pd

from jobs.scoring.scores import ARMS, COUNTED, IOU_METRIC, MATCHED, PENDING, STATUSES, in_order

if TYPE_CHECKING:
    from rich.table import Table

TASK_NAMES = {"eqa": "Question answering", "ground_one": "Grounding, one target", "ground_many": "Grounding, many"}
METRIC_NAMES = {
    "llm_match": "LLM-Match",
    "miou": "3D mIoU",
    "instance_miou": "instance mIoU",
    "zero_target": "zero-target",
    "count_exact": "count right",
    "count_error": "count error",
    "count_bias": "count bias",
}
MAIN_METRICS = ("llm_match", *IOU_METRIC.values())
"""The one score of each task."""
MATCHING = (*MATCHED, "count_error", "count_bias")
"""Scores of the sheet on matched instances."""

SCENES_SHOWN = 30
"""Rows of the table by scene in the terminal and in the report; the frame holds all."""
MIN_WIDTH = 100
"""Columns on which every sheet fits."""
REASONS_SHOWN = 12
"""Most frequent reasons shown of questions without an answer."""
REASON_WIDTH = 100


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table of texts."""

    key: str
    """Short name, unique among the sheets of a run."""
    title: str
    """What it shows."""
    note: str
    """How to read it."""
    columns: tuple[str, ...]
    """Headers."""
    rows: tuple[tuple[str, ...], ...]
    """Cells."""
    words: int
    """How many of the first columns hold words; the others hold numbers."""


def make_sheets(tables: Mapping[str, pd.DataFrame]) -> list[Sheet]:
    """Return the sheets of a run's metrics, from `aggregate`; those without rows are left out."""
    arms, differences = tables["arms"], tables["differences"]
    sheets = [
        *(_ablation(arms[arms["task"] == task], str(task)) for task in TASK_NAMES),
        _matching(arms[arms["task"] == "ground_many"]),
        _differences(differences),
        _denominators(arms[arms["metric"].isin(MAIN_METRICS)]),
        *(_grouped(tables["by_category"], str(task), "category", "Category") for task in TASK_NAMES),
        *(_grouped(tables["by_scene"], str(task), "scene", "Scene") for task in TASK_NAMES),
        _clusters(tables["clusters_by_category"], "category", "Category"),
        _clusters(tables["clusters_by_scene"], "scene", "Scene"),
        _outcomes(tables["outcomes"]),
        _calls(tables["calls"]),
        _timings(tables["timings"]),
    ]
    return [sheet for sheet in sheets if sheet.rows]


def format_tables(tables: Mapping[str, pd.DataFrame], *, by_scene: bool = False) -> list[Table]:
    """Return the sheets for the terminal, to be printed with rich on `MIN_WIDTH` columns or more.

    Args:
        tables: From `aggregate`.
        by_scene: Show the tables by scene too.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    found, last_note = [], ""
    for sheet in make_sheets(tables):
        if sheet.key.startswith("scene-") and not by_scene:
            continue
        table = Table(
            box=box.SIMPLE_HEAD,
            title=Text(sheet.title, "bold"),
            caption=Text(sheet.note) if sheet.note != last_note else None,
            title_justify="left",
            caption_justify="left",
            padding=(0, 1, 0, 0),
            pad_edge=False,
        )
        last_note = sheet.note
        for place, column in enumerate(sheet.columns):
            # Headers and words may wrap; numbers are never cut.
            widest = max(len(text) for text in (*column.split(), *(row[place] for row in sheet.rows)))
            words = place < sheet.words
            table.add_column(
                Text(column),
                justify="left" if words else "right",
                overflow="fold",
                min_width=min(widest, 12) if words else widest,
            )
        for row in sheet.rows:
            table.add_row(*(Text(cell) for cell in row))
        found.append(table)
    return found


def print_tables(tables: Mapping[str, pd.DataFrame], *, by_scene: bool = False) -> None:
    """Print the sheets; on a narrower terminal lines wrap, since rich would cut numbers off."""
    from rich.console import Console

    console = Console()
    if console.width < MIN_WIDTH:
        console = Console(width=MIN_WIDTH)
    for table in format_tables(tables, by_scene=by_scene):
        console.print(table)


def metric_name(metric: str) -> str:
    """Return a metric's name for people."""
    return METRIC_NAMES.get(metric, metric.replace("acc@", "Acc@").replace("f1@", "F1@"))


def interval(row: Any, low: str = "low", high: str = "high") -> str:
    """Return "low … high" of a row of metrics, or a dash where there are too few values."""
    return "–" if pd.isna(row[low]) else f"{row[low]:.1f} … {row[high]:.1f}"


def _ablation(arms: pd.DataFrame, task: str) -> Sheet:
    rows = []
    metrics = [metric for metric in arms["metric"].unique() if metric not in (*MATCHED, *COUNTED)]
    for (method, arm), group in arms.groupby(["method", "arm"], sort=False):
        by_metric = group.set_index("metric")
        main = by_metric.loc[metrics[0]]
        frames = by_metric.loc["frames"]
        rows.append(
            (
                *_method(arms, method),
                str(arm),
                _number(main["mean"]),
                interval(main),
                interval(main, "low_questions", "high_questions"),
                *(_number(by_metric.loc[metric]["mean"]) for metric in metrics[1:]),
                _number(main["mean_zero"]),
                _number(frames["mean"], 2),
                f"{main['scored']} of {main['questions']}",
            )
        )
    first = _method_column(arms)
    columns = [*first, "Arm", metric_name(metrics[0]) if metrics else "", "by scene", "by question"]
    columns += [*(metric_name(metric) for metric in metrics[1:]), "if 0", "frames", "scored"]
    note = "Means of the scored questions, 0 to 100, with 95 % bootstrap intervals that draw scenes and then questions "
    note += "(by scene) or questions alone (by question). if 0: the mean were every unscored question scored 0."
    if arms["few_scenes"].any():
        note += (
            f" With {int(arms['scenes'].max())} scenes the interval by scene is itself unsure, and neither interval "
        )
        note += "speaks of other scenes."
    return Sheet(f"arms-{task}", f"{TASK_NAMES[task]}: ablation", note, tuple(columns), tuple(rows), len(first) + 1)


def _matching(arms: pd.DataFrame) -> Sheet:
    rows = []
    for (method, arm), group in arms.groupby(["method", "arm"], sort=False):
        by_metric = group.set_index("metric")
        cells = [
            _number(by_metric.loc[name]["mean"], digits) if name in by_metric.index else "–"
            for name, digits in zip(MATCHING, (1, 1, 1, 1, 2, 2), strict=True)
        ]
        zero = f"{by_metric.loc['zero_target']['scored']}" if "zero_target" in by_metric.index else "0"
        scored = by_metric.loc[MATCHING[0]]
        rows.append((*_method(arms, method), str(arm), *cells, zero, f"{scored['scored']} of {scored['questions']}"))
    first = _method_column(arms)
    columns = (*first, "Arm", *map(metric_name, MATCHING), "without targets", "scored")
    note = "Multi3DRefer's F1 of instances matched at an IoU of 25 % and 50 %, its accuracy on questions without "
    note += "targets, how often the count is right, by how many instances it is wrong, and the same with its sign."
    return Sheet("matching", "Grounding, many: matched instances", note, columns, tuple(rows), len(first) + 1)


def _differences(differences: pd.DataFrame) -> Sheet:
    rows = []
    for row in differences.to_dict("records"):
        if row["metric"] not in MAIN_METRICS:
            continue
        rows.append(
            (
                *_method(differences, row["method"]),
                metric_name(row["metric"]),
                f"{row['from']} → {row['to']}",
                _signed(row["mean"]),
                interval(row),
                interval(row, "low_questions", "high_questions"),
                _p_value(row["p"]),
                ", ".join(str(row[name]) for name in ("gained", "lost", "tied")),
            )
        )
    first = _method_column(differences)
    columns = (*first, "Score", "From → to", "change", "by scene", "by question", "p")
    note = (
        "Mean change of a question's score, on the questions scored in both arms. p: two-sided paired permutation test "
    )
    note += "over questions. gained, lost, tied: questions."
    title = "What novel views and verification change"
    return Sheet("differences", title, note, (*columns, "gained, lost, tied"), tuple(rows), len(first) + 2)


def _denominators(arms: pd.DataFrame) -> Sheet:
    pending = (PENDING,) if arms[PENDING].any() else ()
    counts = ("questions", *STATUSES, *pending, "no_reference", "scored")
    rows = tuple(
        (
            *_method(arms, row["method"]),
            TASK_NAMES[row["task"]],
            str(row["arm"]),
            *(f"{row[name]:,}" for name in counts),
        )
        for row in arms.to_dict("records")
    )
    first = _method_column(arms)
    columns = (*first, "Task", "Arm", *(name.replace("_", " ") for name in counts))
    note = "A question that was skipped (there was nothing to look at), failed, stayed unreadable or has no reference "
    note += "is in no mean; column `if 0` counts it as 0."
    return Sheet("denominators", "How the questions ended", note, columns, rows, len(first) + 2)


def _grouped(summary: pd.DataFrame, task: str, by: str, header: str) -> Sheet:
    part = summary[(summary["task"] == task) & summary["metric"].isin(MAIN_METRICS)]
    arms = in_order(part["arm"], ARMS)
    rows = []
    for (method, name), group in part.groupby(["method", by], sort=False):
        by_arm = group.set_index("arm")
        last = by_arm.loc[arms[-1]] if arms[-1] in by_arm.index else by_arm.iloc[-1]
        rows.append(
            (
                *_method(summary, method),
                str(name) or "(none)",
                *(_number(by_arm.loc[arm]["mean"]) if arm in by_arm.index else "–" for arm in arms),
                interval(last, "low_questions", "high_questions"),
                f"{last['scored']} of {last['questions']}",
            )
        )
    metric = metric_name(str(part["metric"].iloc[0])) if len(part) else ""
    first = _method_column(summary)
    columns = (*first, header, *map(str, arms), f"{arms[-1]}, by question" if arms else "", "scored")
    note = "Means of the scored questions, 0 to 100; the interval is that of the last arm, over questions."
    if by == "scene" and len(rows) > SCENES_SHOWN:
        note += f" The first {SCENES_SHOWN} of {len(rows)} scenes."
        rows = rows[:SCENES_SHOWN]
    return Sheet(f"{by}-{task}", f"{TASK_NAMES[task]}: {metric} by {by}", note, columns, tuple(rows), len(first) + 1)


def _clusters(summary: pd.DataFrame, by: str, header: str) -> Sheet:
    """Rows with ground truth only: all of them, then the least well clustered first."""
    part = summary[summary["scored"] > 0]
    whole, groups = part[part[by] == "all"], part[part[by] != "all"].sort_values("ari", kind="stable")
    rows = tuple(
        (
            str(row[by]),
            _number(row["ari"], 3),
            *(f"{row[name]:,}" for name in ("clusters", "instances", "matched", "over_split", "under_split")),
            "–" if pd.isna(row["dropped"]) else f"{row['dropped']:.1%}",
            f"{row['scored']} of {row['clusterings']}",
        )
        for row in [*whole.to_dict("records"), *groups.head(SCENES_SHOWN).to_dict("records")]
    )
    note = "Clusters against ground-truth instances, each scene and evidence category once. ARI: mean adjusted Rand "
    note += "index, 1 is perfect. matched: instances with a cluster of IoU above 0.5. split: instances in several "
    note += "clusters. merged: clusters over several instances. dropped: Gaussians in none."
    if len(groups) > SCENES_SHOWN:
        note += f" The {SCENES_SHOWN} with the lowest ARI of {len(groups)}."
    columns = (header, "ARI", "clusters", "instances", "matched", "split", "merged", "dropped", "scored")
    return Sheet(f"{by}-clusters", f"Cluster quality by {by}", note, columns, rows, 1)


def _outcomes(outcomes: pd.DataFrame) -> Sheet:
    part = outcomes[outcomes["status"] != "answered"].sort_values("questions", ascending=False, kind="stable")
    rows = tuple(
        (
            TASK_NAMES.get(str(row["task"]), str(row["task"])),
            str(row["status"]),
            _short(str(row["reason"])),
            str(row["questions"]),
        )
        for row in part.head(REASONS_SHOWN).to_dict("records")
    )
    note = f"The {REASONS_SHOWN} most frequent reasons of {len(part)}." if len(part) > REASONS_SHOWN else ""
    return Sheet("outcomes", "Questions without an answer", note, ("Task", "Status", "Reason", "questions"), rows, 3)


def _calls(calls: pd.DataFrame) -> Sheet:
    several, priced = calls["models"].nunique() > 1, bool(calls["usd"].notna().any())
    rows = tuple(
        (
            str(row["stage"]),
            *((str(row["models"]),) if several else ()),
            *(f"{row[name]:,}" for name in ("calls", "sent", "cached", "unparsed", "failed_tries")),
            f"{row['prompt_tokens'] + row['completion_tokens']:,}",
            _number(row["calls_a_question"], 2),
            _number(row["tokens_a_question"], 0),
            _number(row["seconds_a_call"], 3),
            *((_number(row["seconds_waited"], 1), _number(row["usd"], 4)) if priced else ()),
        )
        for row in calls.to_dict("records")
        if row["calls"] or row["failed_tries"]
    )
    counts = ("calls", "sent", "cached", "unparsed", "failed", "tokens", "calls / q", "tokens / q", "s / call")
    columns = ("Stage", *(("Model",) if several else ()), *counts, *(("s waited", "USD") if priced else ()))
    note = "method: all stages but the judge, which only scores. cached: found among the stored calls, nothing sent. "
    note += "failed: tries that ended in an error. tokens: in and out. q: question."
    if not several and len(calls):
        note += f" Model: {calls['models'].iloc[-1]}."
    return Sheet("calls", "Model calls by stage", note, columns, rows, 2 if several else 1)


def _timings(timings: pd.DataFrame) -> Sheet:
    rows = tuple(
        (
            str(row["stage"]),
            f"a {row['once_a']}",
            _number(row["seconds_each"], 3),
            _number(row["seconds"], 1),
            f"{row['count']:,}",
            "–" if pd.isna(row["seconds_an_item"]) else f"{1000 * row['seconds_an_item']:,.1f}",
            _number(row["longest"], 2),
        )
        for row in timings.to_dict("records")
        if row["count"] or row["seconds"]
    )
    columns = ("Stage", "Each", "seconds each", "seconds in all", "items", "ms / item", "longest, s")
    note = "Wall seconds summed over workers: questions run side by side, so they add up to more than the run took."
    return Sheet("timings", "Seconds by stage", note, columns, rows, 2)


def _method_column(frame: pd.DataFrame) -> tuple[str, ...]:
    """A column for the method where there are several."""
    return ("Method",) if frame["method"].nunique() > 1 else ()


def _method(frame: pd.DataFrame, method: object) -> tuple[str, ...]:
    return (str(method),) if _method_column(frame) else ()


def _number(value: Any, digits: int = 1) -> str:
    return "–" if pd.isna(value) else f"{value:,.{digits}f}"


def _signed(value: Any) -> str:
    return "–" if pd.isna(value) else f"{value:+.1f}"


def _p_value(p: Any) -> str:
    return "–" if pd.isna(p) else "< 0.001" if p < 0.001 else f"{p:.3f}"


def _short(text: str) -> str:
    return text if len(text) <= REASON_WIDTH else text[: REASON_WIDTH - 1] + "…"


def sheet_by_key(sheets: Sequence[Sheet], key: str) -> Sheet | None:
    """Return the sheet of that name, or None where it had no rows."""
    return next((sheet for sheet in sheets if sheet.key == key), None)
