"""The page: summary, tables and plots as HTML, the questions as data that page.js shows when opened.

Whatever comes from a run is escaped here, or set as text by page.js; the page's policy allows no other script, no
network and no frame.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd

from jobs.report.plots import Bar, BarGroup, bar_plot
from jobs.report.questions import LABELS, RIGHT_IOU, RIGHT_MARK
from jobs.scores import ARMS, in_order
from jobs.sheets import MAIN_METRICS, TASK_NAMES, Sheet, make_sheets, metric_name
from jobs.status import RunStatus

HERE = Path(__file__).parent

SCORE_SHEETS = ("differences", "denominators", "category-clusters", "outcomes")
"""Sheets below the ablation."""


@dataclass(frozen=True, slots=True)
class RunFacts:
    """What is known of a run beside its tables."""

    run: Mapping[str, Any]
    """Content of run.json."""
    status: RunStatus
    """How far it is."""


def page(
    facts: RunFacts, metrics: Mapping[str, pd.DataFrame], questions: Sequence[Mapping[str, Any]], *, total: int
) -> str:
    """Return the page.

    Args:
        facts: The run.
        metrics: From `aggregate`.
        questions: From `question_records`.
        total: Committed questions; more than `questions` holds when that was cut.
    """
    style, script = (HERE / "page.css").read_text(), (HERE / "page.js").read_text()
    name = str(facts.run.get("name", "run"))
    sheets = {sheet.key: sheet for sheet in make_sheets(metrics)}
    body = [
        f"<header><h1>{escape(name)}</h1>{_facts(facts)}</header>",
        "<main>",
        _tiles(metrics["arms"]),
        "<section><h2>Scores</h2>",
        *(_table(sheets[f"arms-{task}"]) for task in TASK_NAMES if f"arms-{task}" in sheets),
        *(_table(sheets[key]) for key in SCORE_SHEETS if key in sheets),
        "</section>",
        _groups(metrics, sheets),
        "<section><h2>Cost</h2>",
        _calls_plot(metrics["calls"]),
        *(_table(sheets[key]) for key in ("calls",) if key in sheets),
        _timings_plot(metrics["timings"]),
        *(_table(sheets[key]) for key in ("timings",) if key in sheets),
        "</section>",
        _question_section(len(questions), total),
        _configuration(facts.run),
        "</main>",
    ]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; img-src 'self' file: data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    return "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1"><meta name="color-scheme" '
            'content="light dark">',
            f"<title>{escape(name)} · SplatReasoner</title><style>{style}</style></head><body>",
            *body,
            f'<script type="application/json" id="questions">{_json(list(questions))}</script>',
            f"<script>{script}</script></body></html>",
        ]
    )


def _json(data: Any) -> str:
    """JSON that can stand inside a script element: no character of it can end the element."""
    text = json.dumps(data, ensure_ascii=True, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _facts(facts: RunFacts) -> str:
    status = facts.status
    counts = ", ".join(f"{count:,} {name}" for name, count in sorted(status.statuses.items()))
    models = sorted({_model_name(model) for model in facts.run.get("basis", {}).get("models", {}).values()})
    lines = [
        f"{status.questions_done:,} of {status.questions:,} questions committed ({counts or 'none yet'}), "
        f"in {status.units_done:,} of {status.units:,} units",
        f"Models: {', '.join(models)}" if models else "",
        f"Planned {facts.run.get('created', '')}, source {str(facts.run.get('commit') or 'unknown')[:12]}",
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


def _model_name(identity: Any) -> str:
    if not isinstance(identity, Mapping):
        return str(identity)
    return str(identity.get("model") or identity.get("kind") or identity.get("name") or "unnamed")


def _tiles(arms: pd.DataFrame) -> str:
    """One tile a task: the score of every arm."""
    tiles = []
    main = arms[arms["metric"].isin(MAIN_METRICS)]
    for (_, task), group in main.groupby(["method", "task"], sort=False):
        rows = "".join(
            f'<tr><th scope="row">{escape(str(row["arm"]))}</th><td>{_figure(row["mean"])}</td>'
            f"<td>{_range(row)}</td></tr>"
            for row in group.to_dict("records")
        )
        title = f"{TASK_NAMES[str(task)]}: {metric_name(str(group['metric'].iloc[0]))}"
        last = group.iloc[-1]
        foot = f"{last['scored']} of {last['questions']} questions scored"
        tiles.append(f'<div class="tile"><h3>{escape(title)}</h3><table>{rows}</table><p>{escape(foot)}</p></div>')
    return f'<div class="tiles">{"".join(tiles)}</div>'


def _figure(value: Any) -> str:
    return "–" if pd.isna(value) else f"{value:.1f}"


def _range(row: Mapping[Any, Any]) -> str:
    low, high = row["low_questions"], row["high_questions"]
    return "" if pd.isna(low) else f"{low:.1f} to {high:.1f}"


def _table(sheet: Sheet) -> str:
    head = "".join(
        f'<th scope="col"{"" if place < sheet.words else _NUMBER}>{escape(column)}</th>'
        for place, column in enumerate(sheet.columns)
    )
    rows = "".join(
        "<tr>"
        + "".join(
            f'<th scope="row">{escape(cell)}</th>'
            if place == 0
            else f"<td{'' if place < sheet.words else _NUMBER}>{escape(cell)}</td>"
            for place, cell in enumerate(row)
        )
        + "</tr>"
        for row in sheet.rows
    )
    title, note = escape(sheet.title), escape(sheet.note)
    return (
        f'<figure class="sheet"><figcaption>{title}</figcaption>'
        f'<div class="scroll" tabindex="0" role="region" aria-label="{title}">'
        f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
        f"<p>{note}</p></figure>"
    )


_NUMBER = ' class="number"'


def _groups(metrics: Mapping[str, pd.DataFrame], sheets: Mapping[str, Sheet]) -> str:
    parts = ["<section><h2>By category and scene</h2>", _legend([*ARMS])]
    for task in TASK_NAMES:
        for by, table in (("category", "by_category"), ("scene", "by_scene")):
            key = f"{by}-{task}"
            if key in sheets:
                frame = metrics[table]
                plot = _score_plot(frame[frame["task"] == task], by, sheets[key].title)
                parts.append(f'<div class="pair">{plot}{_table(sheets[key])}</div>')
    return "".join([*parts, "</section>"])


def _score_plot(frame: pd.DataFrame, by: str, title: str) -> str:
    main = frame[frame["metric"].isin(MAIN_METRICS)]
    arms = in_order(main["arm"], ARMS)
    groups = []
    for (method, name), group in list(main.groupby(["method", by], sort=False))[:30]:
        rows = group.set_index("arm")
        label = f"{name or '(none)'}" if main["method"].nunique() == 1 else f"{method}: {name}"
        groups.append(BarGroup(label, tuple(_score_bar(rows, arm) for arm in arms)))
    return _plot(bar_plot(groups, arms, title))


def _score_bar(rows: pd.DataFrame, arm: str) -> Bar:
    if arm not in rows.index:
        return Bar(None)
    row: Any = rows.loc[arm]
    if pd.isna(row["mean"]):
        return Bar(None)
    low, high = (None if pd.isna(row[end]) else float(row[end]) for end in ("low_questions", "high_questions"))
    return Bar(float(row["mean"]), low, high, f"{row['mean']:.1f}")


def _calls_plot(calls: pd.DataFrame) -> str:
    stages = calls[~calls["stage"].isin(("method", "all")) & (calls["calls"] > 0)]
    groups = [BarGroup(row["stage"], (Bar(row["sent"]), Bar(row["cached"]))) for row in stages.to_dict("records")]
    if not groups:
        return ""
    plot = bar_plot(groups, ("sent", "from the cache"), "Model calls by stage", stacked=True)
    return _legend(["sent", "from the cache"]) + _plot(plot)


def _timings_plot(timings: pd.DataFrame) -> str:
    stages = timings[(timings["stage"] != "all") & (timings["seconds"] > 0)]
    groups = [
        BarGroup(
            f"{row['stage']} (a {row['once_a']})", (Bar(row["seconds_each"], text=f"{row['seconds_each']:.3g} s"),)
        )
        for row in stages.to_dict("records")
    ]
    return _plot(bar_plot(groups, ("",), "Seconds by stage"), "single") if groups else ""


def _plot(svg: str, kind: str = "") -> str:
    return f'<div class="plotbox {kind}" tabindex="0" role="region" aria-label="Plot">{svg}</div>'


def _legend(names: Sequence[str]) -> str:
    items = "".join(f'<li><span class="key s{place}"></span>{escape(name)}</li>' for place, name in enumerate(names))
    return f'<ul class="legend">{items}</ul>'


def _question_section(shown: int, total: int) -> str:
    options = "".join(f'<option value="{label}">{escape(name)}</option>' for label, name in LABELS.items())
    cut = (
        f" The first {shown:,} of {total:,} questions are listed; the tables above count all." if shown < total else ""
    )
    return f"""<section id="list"><h2>Questions</h2>
<p class="note">Right: the verified answer has a mark of {RIGHT_MARK} or 5, or an IoU above {RIGHT_IOU:.0%}.
Better and worse compare scores; changed compares what was said.{escape(cut)}</p>
<form class="filters" role="search" aria-label="Filter questions">
<label>Show <select id="label"><option value="">All questions</option>{options}</select></label>
<label>Task <select id="task"><option value="">All</option></select></label>
<label>Category <select id="category"><option value="">All</option></select></label>
<label>Scene <select id="scene"><option value="">All</option></select></label>
<label>Search <input id="search" type="search" autocomplete="off"></label>
</form>
<p id="count" role="status" aria-live="polite"></p>
<noscript><p class="notice">The list of questions needs JavaScript; everything above does not.</p></noscript>
<div id="rows"></div><button id="more" type="button" hidden>Show more</button></section>"""


def _configuration(run: Mapping[str, Any]) -> str:
    parts = []
    for title, key in (("Configuration", "config"), ("What the answers depend on", "basis"), ("Versions", "versions")):
        if key in run:
            text = escape(json.dumps(run[key], indent=1, ensure_ascii=False))
            parts.append(f"<details><summary>{title}</summary><pre>{text}</pre></details>")
    return f"<section><h2>Run</h2>{''.join(parts)}</section>"
