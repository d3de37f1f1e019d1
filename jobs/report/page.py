"""The page of a run: summary, tables and plots as markup; its questions are data that the script shows when opened."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Any
from urllib.parse import quote

import pandas as pd

from jobs.report.plots import Bar, BarGroup, bar_plot
from jobs.report.questions import RIGHT_IOU, RIGHT_MARK
from jobs.report.shell import Section, document, plot_box, question_section, sheet_table
from jobs.report.spending import error_plot, spending_plot
from jobs.runs.status import RunStatus
from jobs.scoring.scores import ARMS, PENDING, STATUSES, in_order
from jobs.scoring.sheets import MAIN_METRICS, TASK_NAMES, Sheet, make_sheets, metric_name

MEANINGS = (
    f"Right: the answer of the last arm has a mark of {RIGHT_MARK} or 5, or an IoU above {RIGHT_IOU:.0%}. "
    "Better and worse compare scores; changed compares what was said."
)
ORDERS = (
    ("", "as planned"),
    ("low", "lowest score first"),
    ("gain", "largest gain first"),
    ("loss", "largest loss first"),
    ("drawn", "with overlays first"),
)


@dataclass(frozen=True, slots=True)
class RunFacts:
    """What is known of a run beside its tables."""

    run: Mapping[str, Any]
    """Content of run.json."""
    status: RunStatus
    """How far it is."""
    events: tuple[Mapping[str, Any], ...] = ()
    """Its diary."""


def page(
    facts: RunFacts, metrics: Mapping[str, pd.DataFrame], tables: Mapping[str, pd.DataFrame], *, shown: int, data: str
) -> str:
    """Return the page.

    Args:
        facts: The run.
        metrics: From `aggregate`.
        tables: Tables `arms` and `timings`.
        shown: Questions in the list; fewer than are committed when it was cut.
        data: Folder of its data, as the page sees it.
    """
    name = str(facts.run.get("name", "run"))
    sheets = {sheet.key: sheet for sheet in make_sheets(metrics)}
    total = facts.status.questions_done
    cut = f" The first {shown:,} of {total:,} questions are listed; the tables count all." if shown < total else ""
    sections = [
        Section("overview", "Overview", _overview(metrics, sheets)),
        Section("scores", "Scores", _scores(metrics, sheets)),
        Section("cost", "Cost", _cost(facts, metrics, sheets, tables)),
        question_section(MEANINGS + cut, ORDERS),
        Section("run", "Run", configuration(facts.run)),
    ]
    return document(name, _facts(facts), sections, data=data, script="report.js")


def _facts(facts: RunFacts) -> str:
    status = facts.status
    counts = ", ".join(f"{count:,} {name}" for name, count in sorted(status.statuses.items()))
    models = sorted({model_name(model) for model in facts.run.get("basis", {}).get("models", {}).values()})
    lines = [
        f"{status.questions_done:,} of {status.questions:,} questions committed ({counts or 'none yet'}), "
        f"in {status.units_done:,} of {status.units:,} units",
        f"Models: {', '.join(models)}" if models else "",
        f"Planned {str(facts.run.get('created', ''))[:16].replace('T', ' ')}, "
        f"source {str(facts.run.get('commit') or 'unknown')[:12]}",
    ]
    notes = []
    if not status.complete:
        notes.append("This run is not complete: the figures below are those of the committed questions.")
    if any(model.startswith("symbolic") for model in models):
        notes.append("The symbolic model answered: an offline stand-in that reads rendered categories, not a VLM.")
    return (
        '<ul class="facts">'
        + "".join(f"<li>{escape(line)}</li>" for line in lines if line)
        + "</ul>"
        + "".join(f'<p class="notice">{escape(note)}</p>' for note in notes)
    )


def model_name(identity: Any) -> str:
    """Return what a model is called in run.json."""
    if not isinstance(identity, Mapping):
        return str(identity)
    return str(identity.get("model") or identity.get("kind") or identity.get("name") or "unnamed")


def _overview(metrics: Mapping[str, pd.DataFrame], sheets: Mapping[str, Sheet]) -> str:
    return "".join(
        [
            "<h2>Overview</h2>",
            _tiles(metrics["arms"]),
            _changes(metrics["differences"]),
            _endings(metrics["arms"]),
            *_score_plots(metrics["by_category"], "category"),
            *(sheet_table(sheets[key]) for key in ("outcomes",) if key in sheets),
        ]
    )


def _tiles(arms: pd.DataFrame) -> str:
    """One tile a task: the score of the last arm, and how it came about."""
    tiles = []
    main = arms[arms["metric"].isin(MAIN_METRICS)]
    for (_, task), group in main.groupby(["method", "task"], sort=False):
        last = group.iloc[-1]
        steps = "".join(
            f'<tr><th scope="row">{escape(str(row["arm"]))}</th><td>{_meter(row)}</td>'
            f"<td>{_figure(row['mean'])}</td><td>{_range(row)}</td></tr>"
            for row in group.to_dict("records")
        )
        title = f"{TASK_NAMES[str(task)]}"
        tiles.append(
            f'<div class="tile"><h3>{escape(title)}</h3><p class="big">{_figure(last["mean"])}'
            f"<small>{escape(metric_name(str(last['metric'])))}, {escape(str(last['arm']))}</small></p>"
            f'<table><thead class="unseen"><tr><th>Arm</th><th>Plot</th><th>Mean</th><th>95 %</th></tr></thead>'
            f"<tbody>{steps}</tbody></table><p>{last['scored']:,} of {last['questions']:,} questions scored; "
            "95 % intervals over questions</p></div>"
        )
    return f'<div class="tiles">{"".join(tiles)}</div>'


def _meter(row: Mapping[Any, Any]) -> str:
    """A line from 0 to 100 with the mean and its interval; the figures beside it say the same."""
    if pd.isna(row["mean"]):
        return ""
    low, high = (row["mean"] if pd.isna(row[end]) else row[end] for end in ("low_questions", "high_questions"))
    return (
        '<svg class="meter" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true">'
        f'<rect class="rail" x="0" y="4" width="100" height="2"/><rect class="span" x="{low:.1f}" y="2.5" '
        f'width="{max(high - low, 0.5):.1f}" height="5"/>'
        f'<rect class="mean" x="{min(row["mean"], 98.8):.1f}" y="0" width="1.2" height="10"/></svg>'
    )


def _figure(value: Any) -> str:
    return "–" if pd.isna(value) else f"{value:.1f}"


def _range(row: Mapping[Any, Any]) -> str:
    low, high = row["low_questions"], row["high_questions"]
    return "" if pd.isna(low) else f"{low:.1f} to {high:.1f}"


def _changes(differences: pd.DataFrame) -> str:
    """One tile a step that could change an answer, with links to the questions it did."""
    tiles = []
    for title, label, first, second in (
        ("Novel views", "novel", "initial", "final"),
        ("Verification", "verify", "final", "verified"),
    ):
        rows = differences[
            (differences["from"] == first) & (differences["to"] == second) & differences["metric"].isin(MAIN_METRICS)
        ]
        lines = "".join(
            f'<tr><th scope="row">{escape(TASK_NAMES[str(row["task"])])}</th>'
            f"<td>{_linked(row['gained'], label + '-better', row['task'])} better</td>"
            f"<td>{_linked(row['lost'], label + '-worse', row['task'])} worse</td><td>{row['tied']:,} alike</td>"
            f"<td>{'–' if pd.isna(row['mean']) else format(row['mean'], '+.1f')}</td></tr>"
            for row in rows.to_dict("records")
        )
        if lines:
            tiles.append(f'<div class="tile"><h3>{title} changed</h3><table>{lines}</table></div>')
    return f'<div class="tiles two">{"".join(tiles)}</div>' if tiles else ""


def _linked(count: int, label: str, task: str) -> str:
    return f'<a href="#questions?label={label}&amp;task={quote(str(task))}">{count:,}</a>' if count else "0"


def _endings(arms: pd.DataFrame) -> str:
    """How the questions ended, as one bar a task."""
    main = arms[arms["metric"].isin(MAIN_METRICS)].drop_duplicates(["method", "task"], keep="last")
    names = [name for name in (*STATUSES, PENDING) if main[name].any()]
    groups = [
        BarGroup(TASK_NAMES[str(row["task"])], tuple(Bar(float(row[name])) for name in names))
        for row in main.to_dict("records")
    ]
    if not groups or len(names) < 2:
        return ""
    title = "How the questions ended"
    return plot_box(title, bar_plot(groups, names, title, stacked=True), names, kind="endings")


def _scores(metrics: Mapping[str, pd.DataFrame], sheets: Mapping[str, Sheet]) -> str:
    grouped = [f"{by}-{task}" for task in TASK_NAMES for by in ("category", "scene")]
    keys = [*(f"arms-{task}" for task in TASK_NAMES), "differences", "matching", "denominators", *grouped]
    return "".join(
        [
            "<h2>Scores</h2>",
            *_tables(sheets, [key for key in keys if key not in grouped]),
            *_score_plots(metrics["by_scene"], "scene"),
            *_tables(sheets, grouped),
            *_tables(sheets, ("category-clusters", "scene-clusters")),
        ]
    )


def _tables(sheets: Mapping[str, Sheet], keys: Iterable[str]) -> list[str]:
    """Return the sheets that are there; a note is said once where several share it."""
    found, last = [], ""
    for key in keys:
        if key in sheets:
            found.append(sheet_table(sheets[key], open_note=sheets[key].note != last))
            last = sheets[key].note
    return found


def _score_plots(frame: pd.DataFrame, by: str) -> list[str]:
    """One plot a task; none by scene where there is one scene, which the tiles show."""
    found = []
    for task, title in TASK_NAMES.items():
        part = frame[(frame["task"] == task) & frame["metric"].isin(MAIN_METRICS)]
        if len(part) == 0 or part[by].nunique() < 2:
            continue
        arms, several = in_order(part["arm"], ARMS), part["method"].nunique() > 1
        groups = []
        for (method, name), group in list(part.groupby(["method", by], sort=False))[:30]:
            rows = group.set_index("arm")
            label = f"{method}: {name}" if several else f"{name or '(none)'}"
            groups.append(BarGroup(label, tuple(_score_bar(rows, arm) for arm in arms)))
        text = f"{title}: {metric_name(str(part['metric'].iloc[0]))} by {by}"
        found.append(plot_box(text, bar_plot(groups, arms, text), arms, "Whiskers: 95 % over questions."))
    return ['<div class="plots">', *found, "</div>"] if found else []


def _score_bar(rows: pd.DataFrame, arm: str) -> Bar:
    if arm not in rows.index:
        return Bar(None)
    row: Any = rows.loc[arm]
    if pd.isna(row["mean"]):
        return Bar(None)
    low, high = (None if pd.isna(row[end]) else float(row[end]) for end in ("low_questions", "high_questions"))
    return Bar(float(row["mean"]), low, high, f"{row['mean']:.1f}")


def _cost(
    facts: RunFacts,
    metrics: Mapping[str, pd.DataFrame],
    sheets: Mapping[str, Sheet],
    tables: Mapping[str, pd.DataFrame],
) -> str:
    plots = [_calls_plot(metrics["calls"]), _timings_plot(metrics["timings"]), spending_plot(facts.events)]
    plots.append(error_plot(tables["arms"], tables["timings"], metrics["by_category"]))
    shown = "".join(plot for plot in plots if plot)
    boxes = f'<div class="plots">{shown}</div>' if shown else ""
    return "".join(["<h2>Cost</h2>", boxes, *_tables(sheets, ("calls", "timings"))])


def _calls_plot(calls: pd.DataFrame) -> str:
    stages = calls[~calls["stage"].isin(("method", "all")) & (calls["calls"] > 0)]
    groups = [BarGroup(row["stage"], (Bar(row["sent"]), Bar(row["cached"]))) for row in stages.to_dict("records")]
    title, names = "Model calls by stage", ("sent", "stored replies")
    return plot_box(title, bar_plot(groups, names, title, stacked=True), names) if groups else ""


def _timings_plot(timings: pd.DataFrame) -> str:
    stages = timings[(timings["stage"] != "all") & (timings["seconds"] > 0)]
    groups = [
        BarGroup(
            row["stage"] if row["once_a"] == "question" else f"{row['stage']}, a {row['once_a']}",
            (Bar(row["seconds_each"], text=f"{row['seconds_each']:.3g} s"),),
        )
        for row in stages.to_dict("records")
    ]
    title, note = "Seconds by stage, a question", "Work done once a scene is marked so."
    return plot_box(title, bar_plot(groups, ("",), title), note=note, kind="single") if groups else ""


def configuration(run: Mapping[str, Any], title: str = "Run") -> str:
    """Return run.json as markup."""
    parts = []
    for name, key in (("Configuration", "config"), ("What the answers depend on", "basis"), ("Versions", "versions")):
        if key in run:
            text = escape(json.dumps(run[key], indent=1, ensure_ascii=False))
            parts.append(f'<details><summary>{name}</summary><pre tabindex="0">{text}</pre></details>')
    return f"<h2>{escape(title)}</h2>{''.join(parts)}"
