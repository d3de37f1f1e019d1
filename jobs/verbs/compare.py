"""`splatreasoner compare`: two runs, question by question."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from jobs.scoring.compare import Comparison

SHOWN = ("task", "metric", "mean_a", "mean_b", "difference", "low", "high", "p", "p_scenes", "gained", "lost", "tied")
"""Columns of the scores in the terminal; --json has all."""
FIELDS_SHOWN = 30
"""Fields of configuration shown in the terminal."""
VALUE_WIDTH = 60


def compare(
    a: Annotated[str, typer.Argument(help="Run folder, a path or URI.", metavar="RUN_A")],
    b: Annotated[str, typer.Argument(help="Another one, or the same with --arm.", metavar="RUN_B")],
    arm: Annotated[
        str, typer.Option(help='Arm to compare, or two as "initial:final"; each that both have by default.')
    ] = "",
    questions: Annotated[bool, typer.Option("--questions", help="List the questions that came out otherwise.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Everything as one JSON object.")] = False,
    page: Annotated[
        Path | None, typer.Option(help="Write a page with both runs side by side, such as comparison.html.")
    ] = None,
    overlays: Annotated[int, typer.Option(min=0, help="With --page: questions of each run that are drawn.")] = 12,
    scenes: Annotated[str, typer.Option(help="With --page: folder with the scenes, as in report.")] = "",
) -> None:
    """Say how run B differs from run A: scores of the same questions, configuration, calls and time.

    Differences are B - A on questions scored in both; intervals draw scenes and then questions; p flips the sign of
    single questions, p scenes that of whole scenes.

    Examples: [bold]splatreasoner compare runs/base runs/more-views --questions[/bold]

    [bold]splatreasoner compare demo/run demo/run --arm initial:final[/bold]

    [bold]splatreasoner compare runs/base runs/more-views --page comparison.html[/bold]
    """
    from jobs.scoring.compare import compare_runs

    found = compare_runs(a, b, arm=arm)
    if page is not None:
        print(_write_page(found, page, overlays, scenes), file=sys.stderr)
    if as_json:
        from jobs.frame_text import to_json

        names = ("scores", "counts", "unpaired", "config", "cost", *(("questions",) if questions else ()))
        frames = {name: getattr(found, name) for name in names}
        if questions:
            frames["questions"] = found.questions[found.questions["changed"]]
        print(to_json({"a": a, "b": b, "warnings": list(found.warnings), **frames}))
        return
    for warning in found.warnings:
        print(f"warning: {warning}")
    _print_scores(found)
    _print_counts(found)
    _print_config(found)
    _print_cost(found)
    if questions:
        _print_questions(found)


def _write_page(found: Comparison, page: Path, overlays: int, scenes: str) -> Path:
    from jobs.report.compare_page import write_comparison
    from jobs.report.pictures import DrawingBudget
    from jobs.runs.progress import for_terminal, on_terminal

    drawing, writing = DrawingBudget(overlays, scenes=scenes), on_terminal("questions written")
    return write_comparison(found, page, drawing=drawing, progress=for_terminal("questions drawn"), writing=writing)


def _print_scores(found: Comparison) -> None:
    from jobs.frame_text import to_text

    for (first, second), rows in found.scores.groupby(["arm_a", "arm_b"], sort=False):
        print(f"{first} of A, {second} of B" if first != second else f"arm {first}")
        scored = rows["scored"].astype(str) + " of " + rows["questions"].astype(str)
        frame = rows[list(SHOWN)].assign(scored=scored)
        for name in ("p", "p_scenes"):
            frame[name] = ["–" if p is None or p != p else "< 0.001" if p < 0.001 else f"{p:.3f}" for p in frame[name]]
        print(to_text(frame))
        if rows["few_scenes"].any():
            print(f"with {int(rows['scenes'].max())} scenes the intervals are themselves unsure")
        print()


def _print_counts(found: Comparison) -> None:
    for row in found.counts.to_dict("records"):
        alone = f", {row['only_a']} only in A, {row['only_b']} only in B" if row["only_a"] or row["only_b"] else ""
        print(f"{row['task']}: {row['shared']} questions in both{alone}")
    print()


def _print_config(found: Comparison) -> None:
    rows = found.config.to_dict("records")
    print("configuration: " + (f"{len(rows)} fields differ" if rows else "no difference"))
    for row in rows[:FIELDS_SHOWN]:
        print(f"  {row['field']}: {_short(row['a'])} -> {_short(row['b'])}")
    if len(rows) > FIELDS_SHOWN:
        print(f"  and {len(rows) - FIELDS_SHOWN} more: --json lists all")
    print()


def _print_cost(found: Comparison) -> None:
    from jobs.frame_text import to_text

    print("cost of the questions in both, stored replies counted like sent ones")
    print(to_text(found.cost))


def _print_questions(found: Comparison) -> None:
    changed = found.questions[found.questions["changed"]]
    print(f"\n{len(changed)} of {len(found.questions)} answers, scores or statuses changed")
    order = changed["difference"].fillna(0.0).sort_values(kind="stable").index
    for row in changed.loc[order].to_dict("records"):
        print(f"{row['question_id']} [{row['task']}, {row['scene']}, {row['arm_a']}] {_short(row['question'])}")
        for side in "ab":
            score = row[f"score_{side}"]
            shown = "no score" if score != score else f"{score:.0f}"
            print(f"  {side.upper()}: {shown}, {row[f'status_{side}']}: {_short(row[f'answer_{side}'] or '')}")


def _short(value: object) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= VALUE_WIDTH else text[: VALUE_WIDTH - 1] + "…"
