"""Scores of a run: one a question, arm and metric, and their means with intervals and denominators."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, get_args

import numpy as np
import pandas as pd
from jaxtyping import Float64

from pipeline.metrics.accuracy import accuracy_at
from pipeline.metrics.llm_match import match_score
from pipeline.metrics.multi_target import F1_PERCENTS, f1_score, zero_target_score
from pipeline.metrics.significance import Interval, bootstrap_interval, permutation_p
from schemas.answers import Status
from schemas.errors import InputError
from schemas.questions import TASKS

ARMS = ("initial", "final", "verified")
"""Arms of the ablation in the order of the method; others follow by name."""

PAIRS = (("initial", "final"), ("final", "verified"), ("initial", "verified"))
"""Arms compared question by question: what novel views add, what verification adds, and both."""

IOU_METRIC = {"ground_one": "miou", "ground_many": "instance_miou"}
"""What the IoU of a grounding task is called; the other metrics are llm_match, acc@k, `MATCHED` and `COUNTED`."""

MATCHED = (*(f"f1@{percent}" for percent in F1_PERCENTS), "zero_target", "count_exact")
"""Of ground_many, 0 to 100: Multi3DRefer's F1, accuracy on the questions without targets alone, and how often as many
instances are predicted as there are."""

COUNTED = ("count_error", "count_bias", "frames")
"""Not of 0 to 100: instances too many or too few (ground_many) and the same with its sign, as means they are the fields
of `pipeline.metrics.count_error.CountError`; and views given to the model."""

STATUSES: tuple[Status, ...] = get_args(Status)

PENDING = "pending"
"""Status of a planned question without committed rows; no row on disk has it."""

_ENDS = ("mean", "low", "high", "low_questions", "high_questions", "scenes", "few_scenes")

PAIRED = (*_ENDS, "scored", "p", "p_scenes", "gained", "lost", "tied")
"""Columns of a paired difference, see `paired`."""


@dataclass(frozen=True, slots=True)
class Options:
    """How metrics are computed.

    Raises:
        InputError: A number is out of its range.
    """

    thresholds: tuple[float, ...] = (8.0, 10.0)
    """IoU thresholds of Acc@k, percent (paper 4.3)."""
    level: float = 0.95
    """Share of draws inside an interval, between 0 and 1."""
    resamples: int = 2_000
    """Draws of each bootstrap, 1 or more."""
    seed: int = 0
    """Of the draws; each row has a stream of its own, so that adding a group changes no other row."""

    def __post_init__(self) -> None:
        if not all(0 <= k < 100 for k in self.thresholds):
            raise InputError(
                "metrics", field="thresholds", expected="percents from 0 to below 100", found=self.thresholds
            )
        if not 0 < self.level < 1:
            raise InputError("metrics", field="level", expected="a number between 0 and 1", found=self.level)
        if self.resamples < 1:
            raise InputError("metrics", field="resamples", expected="1 or more", found=self.resamples)


def score_rows(arms: pd.DataFrame, answers: pd.DataFrame, thresholds: Sequence[float]) -> pd.DataFrame:
    """Return one row a question, arm and metric: `score` is NaN where it is unscored.

    Args:
        arms: Table `arms`, or what `with_planned` makes of it.
        answers: Table `answers`, or what `with_planned` makes of it; tells whether a reference answer is known.
        thresholds: Of Acc@k, percent.

    Raises:
        InputError: A question has two rows for one method and arm.
    """
    keys = ["method", "question_id", "arm"]
    doubled = arms.duplicated(keys)
    if doubled.any():
        first = arms[doubled].iloc[0]
        found = f"two of question {first['question_id']}, arm {first['arm']}"
        raise InputError("table arms", expected="one row a question and arm", found=found)
    base = arms[[*keys, "task", "scene", "category", "status", "frames"]].copy()
    reference = answers.drop_duplicates("question_id").set_index("question_id")["reference"].notna()
    known = base["question_id"].map(reference).fillna(False).astype(bool)
    base["has_reference"] = np.where(base["task"] == "eqa", known, arms["targets"].notna())
    base["arm"] = pd.Categorical(base["arm"], in_order(arms["arm"], ARMS), ordered=True)
    base["task"] = pd.Categorical(base["task"], TASKS, ordered=True)
    marks = [None if pd.isna(mark) else match_score(int(mark)) for mark in arms["mark"]]
    ious = _floats(arms["iou"])
    frames = _floats(base["frames"].where(base["status"] != "failed"))
    pieces = [_metric(base[base["task"] == "eqa"], "llm_match", _floats(pd.Series(marks, base.index, dtype=object)))]
    for task, metric in IOU_METRIC.items():
        rows = base[base["task"] == task]
        pieces.append(_metric(rows, metric, 100 * ious))
        if task == "ground_many":
            pieces += _matched(rows, arms)
        for k in thresholds:
            hits = ious.map(lambda iou, k=k: np.nan if np.isnan(iou) else 100 * accuracy_at([iou], k))
            pieces.append(_metric(rows, f"acc@{k:g}", hits))
    pieces.append(_metric(base, "frames", frames))
    rows = pd.concat(pieces, ignore_index=True).drop(columns="frames")
    order = ["llm_match", *IOU_METRIC.values(), *(f"acc@{k:g}" for k in thresholds), *MATCHED, *COUNTED]
    return rows.assign(metric=pd.Categorical(rows["metric"], list(dict.fromkeys(order)), ordered=True))


def _matched(rows: pd.DataFrame, arms: pd.DataFrame) -> Iterator[pd.DataFrame]:
    """Scores of ground_many that need the instances apart; unscored where the pairs of an older run are unknown."""
    counts = arms.loc[rows.index, ["predicted", "targets"]]
    pairs = arms["pair_ious"].reindex(rows.index) if "pair_ious" in arms else pd.Series(None, rows.index, dtype=object)
    known = {index: (int(found), int(wanted)) for index, found, wanted in counts.dropna().itertuples()}

    def scored(of: Callable[[Any, int, int], float]) -> pd.Series[float]:
        found = {index: of(index, *pair) for index, pair in known.items()}
        return pd.Series(found, dtype=np.float64).reindex(rows.index)

    def f1(index: Any, predicted: int, targets: int, percent: float) -> float:
        ious = () if targets == 0 else pairs[index]
        told = isinstance(ious, tuple | list | np.ndarray)
        return 100 * f1_score([*map(float, ious)], predicted, targets, percent) if told else np.nan

    for percent in F1_PERCENTS:
        yield _metric(rows, f"f1@{percent}", scored(partial(f1, percent=percent)))
    without = rows[counts["targets"].eq(0).fillna(False).astype(bool)]
    yield _metric(without, "zero_target", scored(lambda _, predicted, targets: 100 * zero_target_score(predicted)))
    yield _metric(rows, "count_exact", scored(lambda _, predicted, targets: 100.0 * (predicted == targets)))
    yield _metric(rows, "count_error", scored(lambda _, predicted, targets: abs(predicted - targets)))
    yield _metric(rows, "count_bias", scored(lambda _, predicted, targets: predicted - targets))


def _metric(rows: pd.DataFrame, name: str, scores: pd.Series[float]) -> pd.DataFrame:
    return rows.assign(metric=name, score=scores.reindex(rows.index))


def summarise(scores: pd.DataFrame, by: Sequence[str], options: Options) -> pd.DataFrame:
    """Return one row a group and metric: the mean, its intervals, and the questions it was and was not taken over.

    Args:
        scores: From `score_rows`.
        by: Columns that make a group.
        options: Level and draws.

    Returns:
        `mean` of the scored questions; `mean_zero`: were those that ended without a score 0; `questions`: planned; the
        statuses add up to them; `scored` and `no_reference` are among them.
    """
    found = []
    for key, group in _groups(scores, [*by, "metric"]):
        values = group["score"].to_numpy(np.float64)
        statuses = group["status"].tolist()
        known = group["has_reference"]
        ended = int((known & (group["status"] != PENDING)).sum())
        found.append(
            {
                **dict(zip([*by, "metric"], key, strict=True)),
                **scored_ends(values, group["scene"], key, options),
                "scored": int(np.isfinite(values).sum()),
                "mean_zero": float(np.nansum(values)) / ended if ended and key[-1] not in COUNTED else None,
                "questions": len(group),
                **{status: statuses.count(status) for status in (*STATUSES, PENDING)},
                "no_reference": len(group) - int(known.sum()),
            }
        )
    return pd.DataFrame(
        found, columns=[*by, "metric", *_ENDS, "scored", "mean_zero", "questions", *STATUSES, PENDING, "no_reference"]
    )


def compare(scores: pd.DataFrame, options: Options) -> pd.DataFrame:
    """Return the mean difference of each pair of arms, on the questions scored in both.

    Args:
        scores: From `score_rows`; `COUNTED` are left out.
        options: Level and draws.
    """
    found = []
    for key, group in _groups(scores[~scores["metric"].isin(COUNTED)], ["method", "task", "metric"]):
        wide = group.pivot(index="question_id", columns="arm", values="score")
        scenes = group.drop_duplicates("question_id").set_index("question_id")["scene"].reindex(wide.index)
        for first, second in PAIRS:
            if first not in wide or second not in wide:
                continue
            a, b = wide[first].to_numpy(np.float64), wide[second].to_numpy(np.float64)
            pair = (*key, first, second)
            found.append(
                {
                    **dict(zip(("method", "task", "metric", "from", "to"), pair, strict=True)),
                    **paired(a, b, scenes, pair, options),
                }
            )
    return pd.DataFrame(found, columns=["method", "task", "metric", "from", "to", *PAIRED])


def paired(
    a: Float64[np.ndarray, "n"],
    b: Float64[np.ndarray, "n"],
    scenes: pd.Series[str],
    key: tuple[Any, ...],
    options: Options,
) -> dict[str, Any]:
    """Return the columns `PAIRED` of two scores of the same questions.

    Args:
        a: One score a question, NaN where unscored.
        b: The other, in the same order.
        scenes: Scene of each question.
        key: What is compared; names the stream of draws.
        options: Level and draws.

    Returns:
        The mean of b - a over the questions scored in both, its intervals, how many those are, p by flipping questions
        (`p`) and by flipping whole scenes (`p_scenes`), and in how many b is higher, lower and the same.
    """
    return {
        **scored_ends(b - a, scenes, key, options),
        "scored": int(np.isfinite(b - a).sum()),
        "p": permutation_p(a, b, _rng(options.seed, (*key, "p"))),
        "p_scenes": permutation_p(a, b, _rng(options.seed, (*key, "p", "scenes")), scenes=scenes.tolist()),
        "gained": int((b > a).sum()),
        "lost": int((b < a).sum()),
        "tied": int((b == a).sum()),
    }


def in_order(found: pd.Series[str], known: Sequence[str]) -> list[str]:
    """Return the distinct names, the known ones in their order and then the others."""
    names = set(found)
    return [name for name in known if name in names] + sorted(names - set(known))


def scored_ends(
    values: Float64[np.ndarray, "n"], scenes: pd.Series[str], key: tuple[Any, ...], options: Options
) -> dict[str, Any]:
    """Return the columns `_ENDS`: the mean of the finite values, its interval over scenes, and over questions alone."""
    scored = np.isfinite(values)
    names = scenes.to_numpy(object)[scored].tolist()

    def draw(by_scene: bool) -> Interval:
        rng = _rng(options.seed, (*key, by_scene))
        return bootstrap_interval(
            values[scored], names, rng, by_scene=by_scene, level=options.level, resamples=options.resamples
        )

    plain = draw(by_scene=False)
    clustered = draw(by_scene=True) if len(set(names)) > 1 else plain
    ends = (
        clustered.mean,
        clustered.low,
        clustered.high,
        plain.low,
        plain.high,
        clustered.scenes,
        clustered.few_scenes,
    )
    return dict(zip(_ENDS, ends, strict=True))


def _rng(seed: int, key: tuple[Any, ...]) -> np.random.Generator:
    digest = hashlib.sha256("\n".join(map(str, (seed, *key))).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "little"))


def _groups(frame: pd.DataFrame, by: list[str]) -> Iterator[tuple[tuple[Any, ...], pd.DataFrame]]:
    """Groups sorted by key: tasks, arms and metrics in their own order."""
    for key, group in frame.groupby(by, observed=True, sort=True):
        yield tuple(key), group


def _floats(column: pd.Series[Any]) -> pd.Series[float]:
    values = [np.nan if pd.isna(value) else float(value) for value in column]
    return pd.Series(values, column.index, dtype=np.float64)
