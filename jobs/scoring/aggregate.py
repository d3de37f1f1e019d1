"""From a run's tables to its metrics: every mean with its interval and with what it was taken over.

A question without a score (it failed, a reply stayed unreadable) is in no mean. It is counted beside each mean by its
status, and `mean_zero` gives the mean were all such questions scored 0. A missing answer is a score already: 0, as the
OpenEQA protocol has it. Questions whose reference is unknown cannot be scored by anyone: they are `no_reference`.
Planned questions that are not committed yet are `pending`: the columns `questions` count them, no mean does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from jobs.scoring.cluster_scores import cluster_summary
from jobs.scoring.coverage import Coverage, read_plan, with_planned
from jobs.scoring.scores import PENDING, STATUSES, Options, compare, in_order, score_rows, summarise
from schemas.calls import CALL_FIGURES
from schemas.errors import InputError

STAGES = (
    *("load", "index", "space", "evidence", "activate", "cluster", "visibility", "perturb", "explore"),
    *("render", "quality", "view_answer", "choice", "answer", "verify", "ground", "cluster_quality", "judge"),
)
"""Stages in the order of the method; others follow by name."""

NEEDED = ("answers", "arms", "clusterings", "calls", "timings")
"""Tables of a run that metrics are made from."""

GROUPS = ("method", "task", "category", "scene", "arm")
"""What scores can be grouped by."""

ALWAYS = ("method", "task", "arm")
"""What they always are grouped by."""


def aggregate(run: str | Path, options: Options | None = None) -> dict[str, pd.DataFrame]:
    """Return the metrics of a run's committed questions; see `aggregate_tables`.

    Args:
        run: Run folder, a path or URI.
        options: Thresholds, level and draws.

    Raises:
        InputError: There is no such run, or a part is damaged.
    """
    return aggregate_tables(read_needed(run), options)


def read_needed(run: str | Path) -> dict[str, pd.DataFrame]:
    """Return the tables that `aggregate_tables` needs, calls without the texts of their requests, and the plan.

    Raises:
        InputError: As `aggregate`.
    """
    from schemas.run_folder import read_table

    tables = {name: read_table(run, name, CALL_FIGURES if name == "calls" else None) for name in NEEDED}
    return {**tables, "plan": read_plan(run)}


def grouped(run: str | Path, by: Sequence[str] = (), options: Options | None = None) -> pd.DataFrame:
    """Return one row a group and metric, as `summarise` does, over all planned questions of a run.

    Args:
        run: Run folder, a path or URI.
        by: Columns that make a group, among `GROUPS`; method, task and arm are always among them, since none of these
            share a mean, and columns come in the order of `GROUPS`: a group's interval is the same in every table.
        options: Thresholds, level and draws.

    Raises:
        InputError: There is no such run, a part is damaged, or a column is unknown or named twice.
    """
    return grouped_scores(coverage(run), by, options)


def grouped_scores(covered: Coverage, by: Sequence[str], options: Options | None = None) -> pd.DataFrame:
    """Return the same as `grouped` from what is covered.

    Raises:
        InputError: A column is unknown or named twice.
    """
    options = options or Options()
    if not set(by) <= set(GROUPS) or len(set(by)) < len(by):
        raise InputError("--by", expected=f"some of {', '.join(GROUPS)}, each once", found=", ".join(by))
    scores = score_rows(covered.arms, covered.answers, options.thresholds)
    return summarise(scores, [name for name in GROUPS if name in by or name in ALWAYS], options)


def coverage(run: str | Path) -> Coverage:
    """Return every planned question of a run with its status, and with its rows in every arm.

    Raises:
        InputError: There is no such run, or a part is damaged.
    """
    from schemas.run_folder import read_table

    return with_planned(read_table(run, "arms"), read_table(run, "answers"), read_plan(run))


def aggregate_tables(tables: Mapping[str, pd.DataFrame], options: Options | None = None) -> dict[str, pd.DataFrame]:
    """Return metrics as tables, tidy: one row a group and metric.

    Args:
        tables: `answers`, `arms`, `clusterings`, `calls` and `timings`, with the columns of their records. With
            `plan` (from `read_plan`) planned questions without rows count too, as pending.
        options: Thresholds, level and draws.

    Returns:
        These, by name.

        - arms, by_category, by_scene: one row a task, arm (and group) and metric: llm_match, miou, instance_miou and
          acc@k from 0 to 100; frames a question. `low` and `high` come from the bootstrap over scenes and then
          questions, `low_questions` and `high_questions` from the plain one over questions; counts by status.
        - differences: the same for pairs of arms on the questions scored in both, with the p value of a permutation
          test over questions and the questions gained, lost and tied.
        - clusters_by_category, clusters_by_scene: how clusters meet ground-truth instances, see `cluster_summary`.
        - outcomes: questions by status and reason.
        - calls: calls, tokens, seconds and price of the models by stage. Seconds waited are those before the
          endpoints' limits; the price is that of what was sent, none where an endpoint has no prices.
        - timings: seconds by stage.

    Raises:
        InputError: A question has two rows for one method and arm.
    """
    options = options or Options()
    arms, answers = tables["arms"], tables["answers"]
    outcomes = answers[["method", "task", "status", "reason"]]
    if "plan" in tables:
        covered = with_planned(arms, answers, tables["plan"])
        arms, answers = covered.arms, covered.answers
        pending = tables["plan"][(answers["status"] == PENDING).to_numpy()]
        outcomes = pd.concat([outcomes, pending[["method", "task"]].assign(status=PENDING, reason="")])
    scores = score_rows(arms, answers, options.thresholds)
    questions = int(tables["answers"]["question_id"].nunique())
    return {
        "arms": summarise(scores, ["method", "task", "arm"], options),
        "differences": compare(scores, options),
        "by_category": summarise(scores, ["method", "task", "category", "arm"], options),
        "by_scene": summarise(scores, ["method", "task", "scene", "arm"], options),
        "clusters_by_category": cluster_summary(tables["clusterings"], "category"),
        "clusters_by_scene": cluster_summary(tables["clusterings"], "scene"),
        "outcomes": _outcomes(outcomes),
        "calls": _calls(tables["calls"], questions),
        "timings": _timings(tables["timings"], questions, int(tables["answers"]["scene"].nunique())),
    }


def _outcomes(answers: pd.DataFrame) -> pd.DataFrame:
    by = ["method", "task", "status", "reason"]
    counted = answers.groupby(by, observed=True, sort=False).size().rename("questions").reset_index()
    order = counted["status"].map({status: place for place, status in enumerate((*STATUSES, PENDING))})
    counted = counted.assign(_place=order).sort_values(
        ["method", "task", "_place", "questions", "reason"], ascending=[True, True, True, False, True]
    )
    return counted.drop(columns="_place").reset_index(drop=True)


def _calls(calls: pd.DataFrame, questions: int) -> pd.DataFrame:
    """One row a stage, one for the method (all but the judge) and one for all.

    A call counts once, whether it was sent or found; tries that failed are counted apart.
    """
    found = []
    calls = calls.reset_index(drop=True)
    method = calls[calls["stage"] != "judge"]
    for stage, group in [*_by_stage(calls), ("method", method), ("all", calls)]:
        done = group[group["outcome"].isin(("ok", "unparsed"))]
        sent = done[~done["cached"].astype(bool)]
        tokens = done["prompt_tokens"] + done["completion_tokens"]
        found.append(
            {
                "stage": stage,
                "calls": len(done),
                "cached": len(done) - len(sent),
                "sent": len(sent),
                "asked_again": int((done["attempt"] > 1).sum()),
                "unparsed": int((done["outcome"] == "unparsed").sum()),
                "failed_tries": len(group) - len(done),
                "prompt_tokens": int(done["prompt_tokens"].sum()),
                "completion_tokens": int(done["completion_tokens"].sum()),
                "sent_tokens": int(tokens[sent.index].sum()),
                "calls_a_question": _ratio(len(done), questions),
                "tokens_a_question": _ratio(float(tokens.sum()), questions),
                "seconds_a_call": _ratio(float(sent["latency_s"].sum()), len(sent)),
                "seconds_waited": float(group["wait_s"].sum()),
                "usd": _known_sum(sent["usd"]),
                "usd_a_question": _ratio(_known_sum(sent["usd"]), questions),
                "models": ", ".join(sorted(set(group["model"]))),
            }
        )
    return pd.DataFrame(found)


def _timings(timings: pd.DataFrame, questions: int, scenes: int) -> pd.DataFrame:
    """One row a stage and one for all, first of work done once a scene, then of work done for each question."""
    found = []
    whole = timings["question_id"] == ""
    for once, part in ((True, timings[whole]), (False, timings[~whole])):
        for stage, group in [*_by_stage(part), ("all", part)]:
            seconds, count = float(group["seconds"].sum()), int(group["count"].sum())
            found.append(
                {
                    "stage": stage,
                    "once_a": "scene" if once else "question",
                    "seconds": seconds,
                    "count": count,
                    "seconds_each": _ratio(seconds, scenes if once else questions),
                    "seconds_an_item": _ratio(seconds, count) if stage != "all" else None,
                    "longest": float(group["seconds"].max()) if len(group) else None,
                }
            )
    return pd.DataFrame(found)


def _by_stage(frame: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    return [(stage, frame[frame["stage"] == stage]) for stage in in_order(frame["stage"], STAGES)]


def _ratio(total: float | None, count: int) -> float | None:
    return None if total is None or not count else total / count


def _known_sum(values: pd.Series[Any]) -> float | None:
    """A sum of which one part is unknown is unknown."""
    return None if values.isna().any() else float(values.sum())
