"""Two plots of cost: what was spent as a run went on, and what time bought in score."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any

import pandas as pd

from jobs.report.curves import Dot, dot_plot, growth_plot
from jobs.report.shell import plot_box
from jobs.runs.spend import CallTotals
from jobs.scoring.scores import ARMS, in_order
from jobs.scoring.sheets import MAIN_METRICS, TASK_NAMES


def spending_plot(events: Iterable[Mapping[str, Any]]) -> str:
    """Return what was spent over the minutes of work as markup: dollars, else tokens, else calls; empty when unknown.

    Time between sessions does not count.
    """
    minutes, last, total = 0.0, None, CallTotals()
    points: list[tuple[float, CallTotals]] = [(0.0, total)]
    for event in events:
        try:
            now = datetime.fromisoformat(str(event.get("time")))
        except ValueError:
            continue  # nobody of ours wrote that line
        if event.get("event") == "started" or last is None:
            last = now
        minutes, last = minutes + max(0.0, (now - last).total_seconds() / 60), now
        if event.get("event") == "committed" and isinstance(event.get("calls"), dict):
            total = total + CallTotals.read(event["calls"])
            points.append((minutes, total))
    if len(points) < 3 or not total.sent:
        return ""
    name, curve = "calls sent", [(at, float(one.sent)) for at, one in points]
    if total.usd:
        name, curve = "US dollars", [(at, float(one.usd or 0.0)) for at, one in points]
    elif total.tokens:
        name, curve = "tokens", [(at, float(one.tokens)) for at, one in points]
    title = f"Spent as the run went on: {name}"
    return plot_box(title, growth_plot(curve, "minutes of work", name, title), note="A step is a committed unit.")


def error_plot(arms: pd.DataFrame, timings: pd.DataFrame, by_category: pd.DataFrame) -> str:
    """Return seconds against error as markup, one dot a category; empty where there are fewer than two.

    Args:
        arms: Table `arms`, for who is in which category.
        timings: Table `timings`; work done once a scene is nobody's.
        by_category: From `aggregate`; its means of the last arm over the scored questions.
    """
    own = timings[timings["question_id"] != ""].groupby("question_id")["seconds"].sum()
    asked = arms.drop_duplicates("question_id").set_index("question_id")[["task", "category"]]
    seconds = asked.assign(seconds=own.reindex(asked.index)).groupby(["task", "category"])["seconds"].median()
    main = by_category[by_category["metric"].isin(MAIN_METRICS)]
    last = in_order(main["arm"], ARMS)[-1:]
    rows = [row for row in main[main["arm"].isin(last)].to_dict("records") if not pd.isna(row["mean"])]
    rows = [row for row in rows if not pd.isna(seconds.get((row["task"], row["category"]), float("nan")))]
    if len(rows) < 2:
        return ""
    most = max(row["scored"] for row in rows)
    tasks = [task for task in TASK_NAMES if any(row["task"] == task for row in rows)]
    dots = [
        Dot(
            float(seconds[row["task"], row["category"]]),
            100.0 - row["mean"],
            f"{row['category'] or TASK_NAMES[str(row['task'])]}: {seconds[row['task'], row['category']]:.2f} s, "
            f"error {100.0 - row['mean']:.1f}, {row['scored']} questions",
            tasks.index(str(row["task"])),
            row["scored"] / most,
        )
        for row in rows
    ]
    title = "Time against error"
    note = "A dot is a category; its area grows with its questions. Error: 100 less the mean score."
    names = [TASK_NAMES[task] for task in tasks]
    return plot_box(title, dot_plot(dots, "median seconds a question", "error", title), names, note)
