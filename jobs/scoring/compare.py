"""Two runs, question by question: what differs in their scores, their answers, their configuration and their cost.

Only questions that both runs planned are compared, and only where both ask the same text about the same scene. A score
of one run without a score of the other is in no difference; it is counted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from jobs.scoring.aggregate import STAGES, coverage
from jobs.scoring.coverage import Coverage, read_plan
from jobs.scoring.scores import ARMS, PAIRED, Options, in_order, paired, score_rows
from jobs.scoring.sheets import MAIN_METRICS
from schemas.calls import CALL_FIGURES
from schemas.errors import InputError
from schemas.questions import TASKS
from schemas.run_folder import RunFolder, read_table

NOT_COMPARED = ("name", "output", "workers", "budget", "cache", "calls", "visibility", "images")
"""Fields of a job that change no answer."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs, A and B; every difference is B - A."""

    runs: tuple[str, str]
    """Their folders."""
    scores: pd.DataFrame
    """One row a task, pair of arms and metric: both means over the questions scored in both, the columns `PAIRED` of
    their difference, and in `only_a` and `only_b` the questions scored in one alone."""
    questions: pd.DataFrame
    """One row a question and pair of arms: status, answer and main score in both, and whether they differ."""
    counts: pd.DataFrame
    """One row a task: questions planned in both, in one alone, and pending among the shared ones."""
    unpaired: pd.DataFrame
    """Questions that only one run planned: run ("a" or "b"), question_id, scene, task."""
    config: pd.DataFrame
    """One row a field that differs, with both values: config, basis, versions, commit."""
    cost: pd.DataFrame
    """One row a stage: calls, tokens and seconds of the shared questions in both, and their differences."""
    warnings: tuple[str, ...]
    """What makes the comparison weaker than it looks."""


def compare_runs(a: str | Path, b: str | Path, *, arm: str = "", options: Options | None = None) -> Comparison:
    """Return how run B differs from run A.

    Args:
        a: Run folder, a path or URI.
        b: Another one, or the same to compare two of its arms.
        arm: Arm to compare, or two as "initial:final", the first in A; empty for each arm that both have.
        options: Thresholds, level and draws.

    Raises:
        InputError: A run is missing or damaged, has no committed question or no such arm, or the runs share no question
            or ask different texts under one id.
    """
    options = options or Options()
    runs = str(a), str(b)
    contents = [_compared(RunFolder(run).read_run()) for run in runs]
    plans = read_plan(a), read_plan(b)
    shared = _shared(runs, plans)
    covered = coverage(a), coverage(b)
    for run, one in zip(runs, covered, strict=True):
        if one.pending == one.planned:
            raise InputError(run, expected="a run with committed questions", found="none: resume it first")
    pairs = _pairs(runs, covered, arm)
    scores = _scores(covered[0], shared, options), _scores(covered[1], shared, options)
    config = pd.DataFrame(_differences(contents[0], contents[1]), columns=["field", "a", "b"])
    return Comparison(
        runs,
        pd.DataFrame(_score_rows(scores[0], scores[1], pairs, options)),
        _question_rows(plans[0], covered, scores, shared, pairs),
        _count_rows(plans, covered, shared),
        _unpaired(plans, shared),
        config,
        _cost(runs, shared),
        _warnings(runs, plans, covered, config, shared),
    )


def _shared(runs: tuple[str, str], plans: tuple[pd.DataFrame, ...]) -> pd.Index[Any]:
    """Return the ids of the questions of both runs, in the order of A."""
    both = plans[0].merge(plans[1], on="question_id", suffixes=("_a", "_b"))
    if both.empty:
        found = f"{len(plans[0])} and {len(plans[1])} questions with no id in common"
        raise InputError(f"{runs[0]} and {runs[1]}", expected="runs that share questions", found=found)
    for field in ("question", "task", "scene"):
        other = both[both[f"{field}_a"] != both[f"{field}_b"]]
        if len(other):
            first = other.iloc[0]
            found = f"{first[f'{field}_a']!r} and {first[f'{field}_b']!r}, and {len(other) - 1} more that differ"
            raise InputError(
                f"{runs[0]} and {runs[1]}",
                field=f"{field} of question {first['question_id']}",
                expected="the same in both runs",
                found=found,
            )
    return pd.Index(both["question_id"])


def _pairs(runs: tuple[str, str], covered: tuple[Coverage, ...], arm: str) -> list[tuple[str, str]]:
    have = [in_order(one.arms["arm"], ARMS) for one in covered]
    if not arm:
        both = [(name, name) for name in have[0] if name in have[1]]
        if not both:
            found = (
                f"{', '.join(have[0])} and {', '.join(have[1])}: name one of each, as --arm {have[0][-1]}:{have[1][-1]}"
            )
            raise InputError(f"{runs[0]} and {runs[1]}", expected="an arm that both have", found=found)
        return both
    first, _, second = arm.partition(":")
    pair = first, second or first
    for run, name, names in zip(runs, pair, have, strict=True):
        if name not in names:
            raise InputError(run, field="arm", expected=f"one of {', '.join(names)}", found=name)
    return [pair]


def _scores(covered: Coverage, shared: pd.Index[Any], options: Options) -> pd.DataFrame:
    scores = score_rows(covered.arms, covered.answers, options.thresholds)
    return scores[scores["question_id"].isin(shared)]


def _score_rows(
    a: pd.DataFrame, b: pd.DataFrame, pairs: list[tuple[str, str]], options: Options
) -> Iterator[dict[str, Any]]:
    for first, second in pairs:
        ours, theirs = a[a["arm"] == first], b[b["arm"] == second]
        for (task, metric), group in ours.groupby(["task", "metric"], observed=True, sort=True):
            other = theirs[(theirs["task"] == task) & (theirs["metric"] == metric)].set_index("question_id")["score"]
            left = group["score"].to_numpy("float64")
            right = other.reindex(group["question_id"]).to_numpy("float64")
            both = pd.notna(left) & pd.notna(right)
            yield {
                "task": task,
                "arm_a": first,
                "arm_b": second,
                "metric": metric,
                "mean_a": float(left[both].mean()) if both.any() else None,
                "mean_b": float(right[both].mean()) if both.any() else None,
                **_renamed(paired(left, right, group["scene"], (task, metric, first, second), options)),
                "only_a": int((pd.notna(left) & ~both).sum()),
                "only_b": int((pd.notna(right) & ~both).sum()),
                "questions": len(group),
            }


def _renamed(found: Mapping[str, Any]) -> dict[str, Any]:
    """The mean of differences is called `difference`; with two means beside it, "mean" would say nothing."""
    assert tuple(found) == PAIRED
    return {"difference" if name == "mean" else name: value for name, value in found.items()}


def _question_rows(
    plan: pd.DataFrame,
    covered: tuple[Coverage, ...],
    scores: tuple[pd.DataFrame, ...],
    shared: pd.Index[Any],
    pairs: list[tuple[str, str]],
) -> pd.DataFrame:
    found = []
    known = plan.set_index("question_id").loc[shared, ["scene", "task", "category", "question", "reference"]]
    for pair in pairs:
        rows = known.copy()
        for side, name, one, scored in zip("ab", pair, covered, scores, strict=True):
            arms = one.arms[one.arms["arm"] == name].set_index("question_id").reindex(shared)
            main = scored[(scored["arm"] == name) & scored["metric"].isin(MAIN_METRICS)]
            rows[f"arm_{side}"] = name
            rows[f"status_{side}"] = arms["status"]
            rows[f"answer_{side}"] = arms["answer"].where(arms["status"] == "answered", None)
            rows[f"score_{side}"] = main.set_index("question_id")["score"].reindex(shared)
        rows["difference"] = rows["score_b"] - rows["score_a"]
        same_answer = rows["answer_a"].fillna("") == rows["answer_b"].fillna("")
        same_score = (rows["score_a"] == rows["score_b"]) | (rows["score_a"].isna() & rows["score_b"].isna())
        rows["changed"] = ~(same_answer & same_score & (rows["status_a"] == rows["status_b"]))
        found.append(rows.reset_index())
    return pd.concat(found, ignore_index=True)


def _count_rows(plans: tuple[pd.DataFrame, ...], covered: tuple[Coverage, ...], shared: pd.Index[Any]) -> pd.DataFrame:
    found = []
    for task in in_order(pd.concat([plan["task"] for plan in plans]), TASKS):
        ids = [set(plan.loc[plan["task"] == task, "question_id"]) for plan in plans]
        both = ids[0] & ids[1] & set(shared)
        row: dict[str, Any] = {"task": task, "shared": len(both), "only_a": len(ids[0]) - len(both)}
        row["only_b"] = len(ids[1]) - len(both)
        for side, one in zip("ab", covered, strict=True):
            mine = one.answers[one.answers["question_id"].isin(both)]
            row |= {f"{status}_{side}": int((mine["status"] == status).sum()) for status in ("answered", "pending")}
        found.append(row)
    return pd.DataFrame(found)


def _unpaired(plans: tuple[pd.DataFrame, ...], shared: pd.Index[Any]) -> pd.DataFrame:
    rows = [
        plan.loc[~plan["question_id"].isin(shared), ["question_id", "scene", "task"]].assign(run=side)
        for side, plan in zip("ab", plans, strict=True)
    ]
    return pd.concat(rows, ignore_index=True)[["run", "question_id", "scene", "task"]]


def _compared(content: Mapping[str, Any]) -> dict[str, Any]:
    config = content.get("config")
    kept = {k: v for k, v in config.items() if k not in NOT_COMPARED} if isinstance(config, dict) else {}
    return {"config": kept} | {name: content.get(name) for name in ("basis", "versions", "commit")}


def _differences(a: Any, b: Any, place: str = "") -> list[tuple[str, Any, Any]]:
    """Return where two pieces of plain data differ: dotted place and both values, None where one has nothing."""
    if isinstance(a, dict) and isinstance(b, dict):
        inner = f"{place}." if place else ""
        return [row for key in sorted({*a, *b}) for row in _differences(a.get(key), b.get(key), f"{inner}{key}")]
    return [] if a == b else [(place, a, b)]


def _cost(runs: tuple[str, str], shared: pd.Index[Any]) -> pd.DataFrame:
    sides = {}
    for side, run in zip("ab", runs, strict=True):
        calls, timings = read_table(run, "calls", CALL_FIGURES), read_table(run, "timings")
        calls = calls[calls["question_id"].isin(shared) & calls["outcome"].isin(("ok", "unparsed"))]
        timings = timings[timings["question_id"].isin(shared)]
        by_stage = calls.assign(tokens=calls["prompt_tokens"] + calls["completion_tokens"]).groupby("stage")
        sides[f"calls_{side}"] = by_stage.size()
        sides[f"tokens_{side}"] = by_stage["tokens"].sum()
        sides[f"seconds_{side}"] = timings.groupby("stage")["seconds"].sum()
    frame = pd.DataFrame(sides).fillna(0)
    frame = frame.reindex(in_order(frame.index.to_series(), STAGES))
    frame.loc["all"] = frame.sum()
    frame = frame.astype({name: "int64" for name in sides if not name.startswith("seconds")})
    for name in ("calls", "tokens", "seconds"):
        frame[f"{name}_difference"] = frame[f"{name}_b"] - frame[f"{name}_a"]
    return frame.rename_axis("stage").reset_index()


def _warnings(
    runs: tuple[str, str],
    plans: tuple[pd.DataFrame, ...],
    covered: tuple[Coverage, ...],
    config: pd.DataFrame,
    shared: pd.Index[Any],
) -> tuple[str, ...]:
    told = [f"{run}: {one.notice()}" for run, one in zip(runs, covered, strict=True) if one.pending]
    fields = config["field"]
    if fields.str.startswith(("basis.models.judge", "basis.prompts.judge")).any():
        told.append("the judges differ: LLM-Match marks of the two runs do not measure the same")
    a, b = (plan.set_index("question_id").loc[shared] for plan in plans)
    scenes = a["scene"][a["scene_sha256"] != b["scene_sha256"]].nunique()
    if scenes:
        told.append(f"{scenes} of {a['scene'].nunique()} shared scenes have other files in the two runs")
    references, targets = (
        sum(_plain(x) != _plain(y) for x, y in zip(a[name], b[name], strict=True))
        for name in ("reference", "target_ids")
    )
    if references + targets:
        told.append(f"{references} reference answers and {targets} target lists of shared questions differ")
    return tuple(dict.fromkeys(told))  # a run compared with itself says everything twice


def _plain(found: Any) -> Any:
    """Return a text, a tuple of ids, or None."""
    return found if isinstance(found, str) else None if found is None or pd.api.types.is_scalar(found) else tuple(found)
