"""What a run's questions took: calls, tokens and seconds, one row a question and metric, as scores have them."""

from __future__ import annotations

import pandas as pd

COST_METRICS = ("calls", "tokens", "seconds")
"""Of a question: calls whose reply was used, their tokens, and seconds of work and waiting. "seconds@cluster+render" is
that of the stages named."""

NO_METHOD = ("judge", "cluster_quality")
"""Stages that score and are no part of a method's cost."""

_DONE = ("ok", "unparsed")


def cost_rows(answers: pd.DataFrame, calls: pd.DataFrame, timings: pd.DataFrame) -> pd.DataFrame:
    """Return the cost of every committed question; what it did not take is 0.

    A call counts whether it was sent or its reply was found, tries that failed do not. Seconds are those of this run:
    a stored reply takes none of its model's. Work done once a scene is shared equally by the scene's questions.

    Args:
        answers: Table `answers`.
        calls: Table `calls`.
        timings: Table `timings`.

    Returns:
        Columns question_id, scene, metric, score; metrics calls, tokens, and seconds@STAGE of each stage there is.
    """
    asked = answers[["question_id", "scene"]].drop_duplicates("question_id").set_index("question_id")
    used = calls[calls["outcome"].isin(_DONE) & ~calls["stage"].isin(NO_METHOD)]
    tokens = (used["prompt_tokens"] + used["completion_tokens"]).groupby(used["question_id"]).sum()
    found = {
        "calls": used.groupby("question_id").size().reindex(asked.index),
        "tokens": tokens.reindex(asked.index),
    }
    own = timings[timings["question_id"] != ""].groupby(["stage", "question_id"])["seconds"].sum()
    whole = timings[timings["question_id"] == ""].groupby(["stage", "scene"])["seconds"].sum()
    share = asked["scene"].map(1.0 / asked.groupby("scene").size())
    for stage in sorted({*timings["stage"]} - {*NO_METHOD}):
        seconds = pd.Series(0.0, asked.index)
        if stage in own.index.get_level_values(0):
            seconds = seconds.add(own[stage].reindex(asked.index), fill_value=0.0)
        if stage in whole.index.get_level_values(0):
            seconds = seconds.add(asked["scene"].map(whole[stage]) * share, fill_value=0.0)
        found[f"seconds@{stage}"] = seconds
    wide = pd.DataFrame(found).fillna(0.0).astype("float64")
    rows = wide.melt(ignore_index=False, var_name="metric", value_name="score").reset_index()
    return rows.assign(scene=rows["question_id"].map(asked["scene"]))[["question_id", "scene", "metric", "score"]]


def cost_of(rows: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Return one row a question with the `score` of a cost metric, such as "seconds" or "seconds@cluster+render"."""
    name, _, stages = metric.partition("@")
    if name == "seconds":
        wanted = {f"seconds@{stage}" for stage in stages.split("+")}
        kept = rows[rows["metric"].isin(wanted) if stages else rows["metric"].str.startswith("seconds@")]
    else:
        kept = rows[rows["metric"] == name]
    questions = rows.drop_duplicates("question_id")[["question_id", "scene"]]
    total = kept.groupby("question_id")["score"].sum()
    return questions.assign(score=questions["question_id"].map(total).fillna(0.0)).reset_index(drop=True)
