"""Scores by question and arm: what is scored, what is not, and what each mean was taken over."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from jobs.scoring.scores import Options, compare, in_order, score_rows, summarise
from pipeline.metrics.count_error import count_error
from pipeline.metrics.llm_match import match_score
from schemas.answers import AnswerRow, ArmRow
from schemas.errors import InputError

ARM = ArmRow(
    question_id="q",
    scene="s",
    task="eqa",
    category="c",
    method="m",
    arm="initial",
    status="answered",
    reason="",
    answer="a",
    views=("v",),
    chosen=(),
    frames=2,
    mark=5,
    mark_reason="",
    predicted=None,
    targets=None,
    iou=None,
    region_gaussians=None,
)
ANSWER = AnswerRow(
    question_id="q",
    scene="s",
    task="eqa",
    category="c",
    method="m",
    question="Q?",
    reference="r",
    evidence=(),
    activated=0,
    clusters=0,
    clusters_found=0,
    status="answered",
    reason="",
    answer="a",
    arm="",
    frames=2,
    model="symbolic",
)
QUICK = Options(resamples=200)
COUNTS = ("count_exact", "count_error", "count_bias")


def frames(*rows: dict[str, Any], reference: str | None = "r") -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables `arms` and `answers` of rows that differ from the template as told."""
    arms = [replace(ARM, **row) for row in rows]
    ids = dict.fromkeys(arm.question_id for arm in arms)
    answers = [replace(ANSWER, question_id=name, reference=reference) for name in ids]
    return pd.DataFrame([asdict(arm) for arm in arms]), pd.DataFrame([asdict(answer) for answer in answers])


def _scores(*rows: dict[str, Any], thresholds: tuple[float, ...] = (8.0, 10.0), **options: Any) -> pd.DataFrame:
    return score_rows(*frames(*rows, **options), thresholds)


def _row(summary: pd.DataFrame, metric: str, arm: str = "initial") -> dict[str, Any]:
    (row,) = summary[(summary["metric"] == metric) & (summary["arm"] == arm)].to_dict("records")
    return {str(name): value for name, value in row.items()}


def test_score_rows_eqa_maps_marks_and_leaves_unscored_empty() -> None:
    scores = _scores({"question_id": "a", "mark": 4}, {"question_id": "b", "mark": None, "mark_reason": "unreadable"})
    values = scores[scores["metric"] == "llm_match"].set_index("question_id")["score"]
    assert values["a"] == 75
    assert np.isnan(values["b"])
    assert set(scores["metric"]) == {"llm_match", "frames"}


def test_score_rows_grounding_gives_iou_and_strict_thresholds_in_percent() -> None:
    rows = [
        {"question_id": str(i), "task": "ground_one", "mark": None, "targets": 1, "iou": iou}
        for i, iou in enumerate([0.08, 0.0801, 0.5, None])
    ]
    scores = _scores(*rows, thresholds=(8.0, 25.0))
    wide = scores.pivot(index="question_id", columns="metric", values="score")
    assert wide["miou"].tolist()[:3] == pytest.approx([8, 8.01, 50])
    assert wide["acc@8"].tolist()[:3] == [0, 100, 100]
    assert wide["acc@25"].tolist()[:3] == [0, 0, 100]
    assert wide.loc["3", ["miou", "acc@8", "acc@25"]].isna().all()


def test_score_rows_accepts_nullable_integers_as_tables_hold_them() -> None:
    arms, answers = frames({"question_id": "a", "mark": 3}, {"question_id": "b", "mark": None})
    arms["mark"] = pd.array(arms["mark"].astype(object).where(arms["mark"].notna(), None), dtype=pd.Int32Dtype())
    scores = score_rows(arms, answers, ())
    assert scores[scores["metric"] == "llm_match"]["score"].tolist()[0] == 50


def test_score_rows_doubled_question_raises() -> None:
    with pytest.raises(InputError, match="two of question q, arm initial"):
        _scores({}, {})


def test_summarise_counts_every_question_and_averages_the_scored() -> None:
    rows = [
        {"question_id": "a", "mark": 5},
        {"question_id": "b", "mark": 1},
        {"question_id": "c", "mark": None, "mark_reason": "unreadable"},
        {"question_id": "d", "mark": None, "status": "unparsed"},
        {"question_id": "e", "mark": None, "status": "failed", "frames": 0},
        {"question_id": "f", "mark": None, "status": "skipped", "frames": 0},
    ]
    summary = summarise(_scores(*rows), ["method", "task", "arm"], QUICK)
    row = _row(summary, "llm_match")
    assert (row["mean"], row["scored"], row["questions"]) == (50, 2, 6)
    assert [row[name] for name in ("answered", "unparsed", "failed", "skipped")] == [3, 1, 1, 1]
    assert row["mean_zero"] == pytest.approx(100 / 6)
    assert row["no_reference"] == 0
    frames_row = _row(summary, "frames")
    assert (frames_row["mean"], frames_row["scored"]) == (8 / 5, 5)


def test_summarise_questions_without_reference_are_in_no_mean() -> None:
    row = _row(summarise(_scores({"mark": None}, reference=None), ["method", "task", "arm"], QUICK), "llm_match")
    assert (row["no_reference"], row["scored"], row["questions"]) == (1, 0, 1)
    assert np.isnan(row["mean"] if row["mean"] is not None else np.nan)
    assert row["mean_zero"] is None or np.isnan(row["mean_zero"])


def test_summarise_group_is_the_same_whatever_else_is_there() -> None:
    rows = [
        {"question_id": f"{i}", "mark": 1 + i % 5, "scene": f"s{i % 4}", "category": "xy"[i % 2]} for i in range(40)
    ]
    by = ["method", "task", "category", "arm"]
    whole = summarise(_scores(*rows), by, QUICK)
    part = summarise(_scores(*rows[::2]), by, QUICK)
    pd.testing.assert_frame_equal(
        whole[whole["category"] == "x"].reset_index(drop=True), part.reset_index(drop=True), check_dtype=False
    )


def test_summarise_keeps_the_order_of_tasks_arms_and_metrics() -> None:
    rows = [
        {"question_id": f"{task}", "task": task, "arm": arm, "targets": 1, "iou": 0.5, "mark": None}
        for task in ("ground_many", "ground_one")
        for arm in ("verified", "other", "final", "initial")
    ]
    summary = summarise(_scores(*rows, thresholds=(10.0, 8.0)), ["method", "task", "arm"], QUICK)
    assert summary["task"].drop_duplicates().tolist() == ["ground_one", "ground_many"]
    assert summary["arm"].drop_duplicates().tolist() == ["initial", "final", "verified", "other"]
    many = summary[(summary["task"] == "ground_many") & (summary["arm"] == "final")]
    assert many["metric"].tolist() == ["instance_miou", "acc@10", "acc@8", "f1@25", "f1@50", *COUNTS, "frames"]


def test_summarise_and_compare_of_nothing_are_empty_with_their_columns() -> None:
    arms, answers = frames({})
    empty = score_rows(arms.head(0), answers.head(0), (8.0,))
    assert len(summarise(empty, ["method", "task", "arm"], QUICK)) == 0
    assert {"mean", "low", "p"} <= set(compare(empty, QUICK).columns)


def test_compare_uses_questions_scored_in_both_arms() -> None:
    marks = {"a": (1, 5), "b": (3, 3), "c": (5, 4), "d": (None, 5), "e": (2, None)}
    rows = [
        {"question_id": name, "arm": arm, "mark": mark, "scene": f"s{name}"}
        for name, pair in marks.items()
        for arm, mark in zip(("initial", "final"), pair, strict=True)
    ]
    (row,) = compare(_scores(*rows), QUICK).to_dict("records")
    assert (row["from"], row["to"], row["scored"], row["scenes"]) == ("initial", "final", 3, 3)
    assert row["mean"] == pytest.approx((100 + 0 - 25) / 3)
    assert (row["gained"], row["lost"], row["tied"]) == (1, 1, 1)
    assert row["p"] == 1.0
    assert row["few_scenes"]


def test_compare_means_agree_with_summaries_when_all_are_scored() -> None:
    rng = np.random.default_rng(0)
    rows = [
        {"question_id": f"{i}", "arm": arm, "mark": int(rng.integers(1, 6)), "scene": f"s{i % 3}"}
        for i in range(50)
        for arm in ("initial", "final", "verified")
    ]
    scores = _scores(*rows)
    summary = summarise(scores, ["method", "task", "arm"], QUICK)
    means = {arm: _row(summary, "llm_match", arm)["mean"] for arm in ("initial", "final", "verified")}
    for row in compare(scores, QUICK).to_dict("records"):
        assert row["mean"] == pytest.approx(means[row["to"]] - means[row["from"]])
        assert row["low"] <= row["mean"] <= row["high"]
    assert means["initial"] == pytest.approx(np.mean([match_score(r["mark"]) for r in rows[::3]]))


@pytest.mark.parametrize("bad", [{"thresholds": (100.0,)}, {"level": 1.0}, {"resamples": 0}])
def test_options_out_of_range_raise(bad: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(bad))):
        Options(**bad)


def test_in_order_known_names_come_first() -> None:
    assert in_order(pd.Series(["z", "final", "a", "initial", "a"]), ("initial", "final")) == [
        "initial",
        "final",
        "a",
        "z",
    ]


MANY = {"task": "ground_many", "mark": None}


def _many(name: str, predicted: int | None, targets: int, ious: tuple[float, ...] | None) -> dict[str, Any]:
    iou = None if predicted is None else 0.5
    return {**MANY, "question_id": name, "predicted": predicted, "targets": targets, "iou": iou, "pair_ious": ious}


def test_score_rows_many_targets_gives_f1_zero_target_accuracy_and_count_error() -> None:
    rows = [
        _many("a", 2, 3, (0.6, 0.25)),
        _many("b", 0, 0, ()),
        _many("c", 2, 0, ()),
        _many("failed", None, 1, None),
        _many("of version 1", 1, 1, None),
    ]
    wide = _scores(*rows).pivot(index="question_id", columns="metric", values="score")
    assert wide["f1@25"].dropna().to_dict() == {"a": 80.0, "b": 100.0, "c": 0.0}
    assert wide["f1@50"].dropna().to_dict() == {"a": 40.0, "b": 100.0, "c": 0.0}
    assert wide["zero_target"].dropna().to_dict() == {"b": 100.0, "c": 0.0}
    assert wide["count_error"].dropna().to_dict() == {"a": 1, "b": 0, "c": 2, "of version 1": 0}


def test_summarise_zero_target_accuracy_counts_only_questions_without_targets() -> None:
    rows = [_many("a", 2, 3, (0.6, 0.25)), _many("b", 0, 0, ()), _many("c", 2, 0, ())]
    summary = summarise(_scores(*rows), ["method", "task", "arm"], QUICK)
    assert (_row(summary, "zero_target")["mean"], _row(summary, "zero_target")["questions"]) == (50, 2)
    wanted = count_error([2, 0, 2], [3, 0, 0])
    means = [_row(summary, metric)["mean"] for metric in COUNTS]
    assert means == pytest.approx([100 * wanted.exact, wanted.mean_absolute, wanted.bias])
    assert pd.isna(_row(summary, "count_error")["mean_zero"])


def test_compare_leaves_counts_out() -> None:
    rows = [_many("a", 2, 3, (0.6, 0.25)) | {"arm": arm} for arm in ("initial", "final")]
    assert set(compare(_scores(*rows), QUICK)["metric"]) == {
        "instance_miou",
        "acc@8",
        "acc@10",
        "f1@25",
        "f1@50",
        "count_exact",
    }
