"""Costs of questions against sums over the tables they come from."""

from __future__ import annotations

import dataclasses

import pandas as pd
import pytest

from jobs.scoring.cost_rows import cost_of, cost_rows
from tests.jobs.synthetic_run import synthetic_rows


def _frames() -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    rows = synthetic_rows(24)
    answers, calls, timings = (pd.DataFrame(map(dataclasses.asdict, rows[n])) for n in ("answers", "calls", "timings"))
    return answers, calls, timings


def test_sums_equal_those_of_the_tables() -> None:
    answers, calls, timings = _frames()
    costs = cost_rows(answers, calls, timings)
    used = calls[calls["outcome"].isin(["ok", "unparsed"]) & (calls["stage"] != "judge")]
    assert cost_of(costs, "calls")["score"].sum() == len(used)
    tokens = used["prompt_tokens"].sum() + used["completion_tokens"].sum()
    assert cost_of(costs, "tokens")["score"].sum() == tokens
    spent = timings[timings["stage"] != "judge"]["seconds"].sum()
    assert cost_of(costs, "seconds")["score"].sum() == pytest.approx(spent)
    part = timings[timings["stage"].isin(["cluster", "render"])]["seconds"].sum()
    assert cost_of(costs, "seconds@cluster+render")["score"].sum() == pytest.approx(part)


def test_work_done_once_a_scene_is_shared_by_its_questions() -> None:
    answers, calls, timings = _frames()
    index = cost_of(cost_rows(answers, calls, timings), "seconds@index")
    for scene, seconds in timings[timings["stage"] == "index"].groupby("scene")["seconds"]:
        own = index[index["scene"] == scene]["score"]
        assert own.nunique() == 1
        assert own.sum() == pytest.approx(seconds.sum())


def test_questions_that_took_nothing_count_as_zero() -> None:
    answers, calls, timings = _frames()
    costs = cost_of(cost_rows(answers, calls.head(0), timings.head(0)), "calls")
    assert (len(costs), costs["score"].sum()) == (24, 0)
