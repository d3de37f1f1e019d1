"""The page of a comparison: what differs between two runs, and both runs' questions side by side."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pandas as pd

from jobs.report.listing import in_files, list_data, prompt_templates, scenery
from jobs.report.pictures import DrawingBudget, draw_pictures
from jobs.report.plots import Bar, BarGroup, bar_plot
from jobs.report.questions import LISTED, OF_A_QUESTION, Lines, Questions
from jobs.report.shards import DataFolder
from jobs.report.shell import Section, document, plot_box, question_section, sheet_table
from jobs.report.write import MAX_QUESTIONS
from jobs.runs.progress import Progress, Silent
from jobs.scoring.compare import Comparison
from jobs.scoring.sheets import MAIN_METRICS, TASK_NAMES, Sheet, interval, metric_name
from schemas import storage
from schemas.run_folder import RunFolder, read_table
from schemas.run_rows import RunRows

OUTCOMES: Mapping[str, str] = {
    "better": "B better",
    "worse": "B worse",
    "changed": "Changed",
    "same": "The same",
    "unscored": "Not scored in both",
}
"""Filters of the list, in order."""
ORDERS = (
    ("", "as planned"),
    ("gain", "B better first"),
    ("loss", "B worse first"),
    ("low", "lowest score of B first"),
    ("drawn", "with overlays first"),
)
MEANINGS = "Better and worse compare the scores of the last pair of arms; changed: status, answer or score differs."
FIELDS_SHOWN = 200


def write_comparison(
    found: Comparison,
    output: Path,
    *,
    max_questions: int = MAX_QUESTIONS,
    drawing: DrawingBudget | None = None,
    progress: Progress | None = None,
    writing: Progress | None = None,
) -> Path:
    """Write the page of a comparison, with a folder of its data beside it, and return its path.

    Thumbnails stay where they are, in the folders of the runs, and are linked from there.

    Args:
        found: From `compare_runs`.
        output: The page; its data lie in a folder of the same name that ends in "-data".
        max_questions: Questions listed, in the order of A; the tables count all.
        drawing: How many questions get pictures from their scenes, in each run.
        progress: Who is told how drawing goes; None for nobody.
        writing: Who is told how writing goes; None for nobody.

    Raises:
        InputError: A run is damaged, or the page may not be written.
    """
    name = f"{output.stem}-data"
    data = DataFolder(str(output.parent / name), quote(name))
    runs = [RunFolder(run).read_run() for run in found.runs]
    rows = found.questions.drop_duplicates("question_id", keep="last").head(max_questions)
    listed = [_listed({str(key): value for key, value in row.items()}) for row in rows.to_dict("records")]
    sides, drawn = [], []
    for root, run in zip(found.runs, runs, strict=True):
        questions = _questions(root, output)
        config = run.get("config")
        method = config.get("method", {}) if isinstance(config, dict) else {}
        committed = set(questions.ids)
        here = [row for row in listed if row["id"] in committed]
        drawn.append(draw_pictures(root, method, questions, here, data, drawing or DrawingBudget(), progress))
        sides.append(questions)
    for file, ids in in_files([row["id"] for row in listed], writing or Silent()):
        lines = Lines()
        records = [questions.records(ids, lines) for questions in sides]
        pairs = [[_with(records[side], key, drawn[side].questions) for side in (0, 1)] for key in ids]
        data.script(file, {"records": pairs, "lines": lines.all()})
    names = [str(run.get("name", "run")) for run in runs]
    prompts = {prompt["sha256"]: prompt for run in runs for prompt in prompt_templates(run)}
    more = {"scenery": [scenery(one) for one in drawn], "names": names, "prompts": list(prompts.values())}
    data.script("list", list_data(listed, OUTCOMES, {key for one in drawn for key in one.questions}, **more))
    data.tidy()
    content = comparison_page(found, names, shown=len(listed), data=data.name)
    storage.write_bytes_atomic(str(output), content.encode("utf-8", "replace"))
    return output


def comparison_page(found: Comparison, names: Sequence[str], *, shown: int, data: str) -> str:
    """Return the page.

    Args:
        found: From `compare_runs`.
        names: Names of A and B.
        shown: Questions in the list.
        data: Folder of its data, as the page sees it.
    """
    facts = "".join(
        f"<li><b>{side}</b> {escape(name)}: {escape(run)}</li>"
        for side, name, run in zip("AB", names, found.runs, strict=True)
    )
    head = f'<ul class="facts">{facts}</ul>' + "".join(
        f'<p class="notice">{escape(warning)}</p>' for warning in found.warnings
    )
    total = found.questions["question_id"].nunique()
    cut = f" The first {shown:,} of {total:,} questions are listed; the tables count all." if shown < total else ""
    sections = [
        Section("overview", "Overview", _overview(found)),
        Section("changes", "Configuration and cost", _changes(found)),
        question_section(MEANINGS + cut, ORDERS),
    ]
    return document(f"{names[0]} against {names[1]}", head, sections, data=data, script="compare.js")


def _questions(run: str, output: Path) -> Questions:
    here = storage.local_path(run)
    images = storage.list_files(storage.join(run, "images"), recursive=True) if here is not None else ()
    link = "" if here is None else quote(os.path.relpath(here, output.parent).replace(os.sep, "/")) + "/"
    tables = {name: read_table(run, name) for name in ("answers", *OF_A_QUESTION)}
    return Questions(tables, RunRows(run), {f"images/{name}" for name in images}, len(tables["answers"]), link)


def _with(
    records: Mapping[str, Mapping[str, Any]], key: str, drawn: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any] | None:
    return {**records[key], "drawn": drawn.get(key)} if key in records else None


def _listed(row: Mapping[str, Any]) -> dict[str, Any]:
    scores = [None if pd.isna(row[f"score_{side}"]) else round(float(row[f"score_{side}"]), 1) for side in "ab"]
    labels = ["changed"] if row["changed"] else ["same"]
    if None in scores:
        labels.append("unscored")
    elif row["difference"]:
        labels.append("better" if row["difference"] > 0 else "worse")
    answers = [f"{side.upper()}: {row[f'answer_{side}'] or row[f'status_{side}']}"[:LISTED] for side in "ab"]
    return {
        "id": row["question_id"],
        "scene": row["scene"],
        "task": row["task"],
        "category": row["category"],
        "question": str(row["question"])[:LISTED],
        "reference": "" if pd.isna(row["reference"]) else str(row["reference"])[:LISTED],
        "answer": "\n".join(answers),
        "labels": labels,
        "scores": scores,
    }


def _overview(found: Comparison) -> str:
    main = found.scores[found.scores["metric"].isin(MAIN_METRICS)].drop_duplicates("task", keep="last")
    tiles = "".join(_tile({str(key): value for key, value in row.items()}) for row in main.to_dict("records"))
    rows = tuple(
        (
            TASK_NAMES[str(row["task"])],
            row["arm_a"] if row["arm_a"] == row["arm_b"] else f"{row['arm_a']}, {row['arm_b']}",
            metric_name(str(row["metric"])),
            *(_figure(row[name]) for name in ("mean_a", "mean_b")),
            _figure(row["difference"], "+.1f"),
            interval(row),
            *(_p_value(row[name]) for name in ("p", "p_scenes")),
            f"{row['gained']}, {row['lost']}, {row['tied']}",
            f"{row['scored']} of {row['questions']}",
        )
        for row in found.scores.to_dict("records")
    )
    columns = ("Task", "Arm", "Score", "A", "B", "B - A", "95 %", "p", "p scenes", "gained, lost, tied", "scored")
    note = "Questions scored in both runs. The interval draws scenes and then questions; p flips the sign of single "
    note += "questions, p scenes that of whole scenes."
    scores = Sheet("scores", "Scores of the same questions", note, columns, rows, 3)
    counts = tuple(
        (TASK_NAMES[str(row["task"])], *(str(row[name]) for name in found.counts.columns if name != "task"))
        for row in found.counts.to_dict("records")
    )
    headers = ("Task", *(str(name).replace("_", " ") for name in found.counts.columns if name != "task"))
    shared = Sheet("counts", "Questions of both runs", "", headers, counts, 1)
    return "".join(
        ["<h2>Overview</h2>", f'<div class="tiles">{tiles}</div>', *_plots(found.questions)]
        + [sheet_table(sheet) for sheet in (scores, shared) if sheet.rows]
    )


def _tile(row: Mapping[str, Any]) -> str:
    task = str(row["task"])
    links = ", ".join(
        f'<a href="#questions?label={label}&amp;task={quote(task)}">{row[count]:,} {label}</a>'
        if row[count]
        else f"0 {label}"
        for label, count in (("better", "gained"), ("worse", "lost"))
    )
    return (
        f'<div class="tile"><h3>{escape(TASK_NAMES[task])}</h3><p class="big">{_figure(row["difference"], "+.1f")}'
        f"<small>{escape(metric_name(str(row['metric'])))}, B - A</small></p>"
        f"<p>{_figure(row['mean_a'])} in A, {_figure(row['mean_b'])} in B; "
        f"95 % {escape(interval(row))}, p {escape(_p_value(row['p']))}</p>"
        f"<p>{links}, {row['tied']:,} alike</p>"
        f"<p>{row['scored']:,} of {row['questions']:,} questions scored in both</p></div>"
    )


def _plots(questions: pd.DataFrame) -> list[str]:
    last = questions.drop_duplicates("question_id", keep="last").dropna(subset=["score_a", "score_b"])
    plots = []
    for task, title in TASK_NAMES.items():
        means = last[last["task"] == task].groupby("category")[["score_a", "score_b"]].mean()
        groups = [
            BarGroup(str(name) or "(none)", (Bar(float(row["score_a"])), Bar(float(row["score_b"]))))
            for name, row in means.head(30).iterrows()
        ]
        if groups:
            text = f"{title} by category"
            plots.append(plot_box(text, bar_plot(groups, ("A", "B"), text), ("A", "B")))
    return ['<div class="plots">', *plots, "</div>"] if plots else []


def _changes(found: Comparison) -> str:
    config = tuple((str(row["field"]), _text(row["a"]), _text(row["b"])) for row in found.config.to_dict("records"))
    note = f"The first {FIELDS_SHOWN} of {len(config)}." if len(config) > FIELDS_SHOWN else ""
    fields = Sheet("config", "Fields that differ", note, ("Field", "A", "B"), config[:FIELDS_SHOWN], 3)
    names = [str(name) for name in found.cost.columns if name != "stage"]
    cost = tuple(
        (str(row["stage"]), *(_figure(row[name], ",.2f" if name.startswith("seconds") else ",.0f") for name in names))
        for row in found.cost.to_dict("records")
    )
    note = "Of the questions in both; a stored reply counts like a sent one."
    costs = Sheet("cost", "Cost by stage", note, ("Stage", *(name.replace("_", " ") for name in names)), cost, 1)
    shown = sheet_table(fields) if fields.rows else "<p>No field of configuration differs.</p>"
    return f"<h2>Configuration and cost</h2>{shown}{sheet_table(costs)}"


def _figure(value: Any, style: str = ".1f") -> str:
    return "–" if pd.isna(value) else format(value, style)


def _p_value(p: Any) -> str:
    return "–" if pd.isna(p) else "< 0.001" if p < 0.001 else f"{p:.3f}"


def _text(value: Any) -> str:
    return "–" if value is None else " ".join(str(value).split())[:LISTED]
