"""Multi3DRefer's F1 against its rule written out, its public implementation, and boxes made of unit cubes."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.metrics.instance_iou import instance_iou
from pipeline.metrics.multi_target import F1_PERCENTS, f1_score, zero_target_score

SIDE = 6
"""Cubes along each axis of the room: small, so that random boxes overlap."""

Box = tuple[tuple[int, int, int], tuple[int, int, int]]
_SPAN = st.tuples(st.integers(0, SIDE - 1), st.integers(1, 4)).map(lambda s: (s[0], min(SIDE, s[0] + s[1])))
BOXES = st.lists(
    st.tuples(_SPAN, _SPAN, _SPAN).map(lambda b: (tuple(a for a, _ in b), tuple(z for _, z in b))), max_size=4
)
"""Lowest and highest corner, whole numbers."""


def _cubes(box: Box) -> np.ndarray:
    """Numbers of the unit cubes in a box: a Gaussian each."""
    (x0, y0, z0), (x1, y1, z1) = box
    grid = np.arange(SIDE**3).reshape(SIDE, SIDE, SIDE)
    return grid[x0:x1, y0:y1, z0:z1].ravel()


def _box_iou(a: Box, b: Box) -> float:
    shared = np.prod([max(0, min(a[1][i], b[1][i]) - max(a[0][i], b[0][i])) for i in range(3)])
    volumes = [np.prod([box[1][i] - box[0][i] for i in range(3)]) for box in (a, b)]
    return float(shared / (sum(volumes) - shared))


def _by_rule(predicted: list[Box], targets: list[Box], least: float) -> set[float]:
    """Every F1 that a best assignment on the table padded to a square may give: several where sums are equal."""
    if not targets:
        return {float(not predicted)}
    side = max(len(predicted), len(targets))
    table = np.zeros((side, side))
    for i, j in itertools.product(range(len(predicted)), range(len(targets))):
        table[i, j] = _box_iou(predicted[i], targets[j])
    sums: dict[float, set[float]] = {}
    for columns in itertools.permutations(range(side)):
        chosen = table[range(side), columns]
        hits = int((chosen >= least).sum())
        sums.setdefault(round(float(chosen.sum()), 9), set()).add(2 * hits / (len(predicted) + len(targets)))
    return sums[max(sums)]


def _ours(predicted: list[Box], targets: list[Box], percent: float) -> float:
    found = instance_iou([*map(_cubes, predicted)], [*map(_cubes, targets)], np.ones(SIDE**3))
    return f1_score([iou for _, _, iou in found.pairs], len(predicted), len(targets), percent)


@settings(deadline=None)  # the first call imports SciPy
@given(BOXES, BOXES)
def test_f1_is_that_of_the_best_assignment_on_a_padded_square(predicted: list[Box], targets: list[Box]) -> None:
    for percent in F1_PERCENTS:
        assert _ours(predicted, targets, percent) in _by_rule(predicted, targets, percent / 100)


@pytest.fixture(scope="module")
def metric() -> Any:
    """The public matcher, without the ground truth it would download."""
    pytest.importorskip("torchmetrics_ext", reason="torchmetrics-ext is not installed")
    name = "torchmetrics_ext.metrics.visual_grounding._multi_target_grounding"
    public: Any = pytest.importorskip(name, reason="torchmetrics-ext lacks one of its own packages")
    return type("Plain", (public.MultiTargetGroundingMetric,), {"_load_gt_data": lambda self, split: None})(
        "validation"
    )


@settings(deadline=None)
@given(predicted=BOXES, targets=BOXES)
def test_f1_equals_the_public_implementation(metric: Any, predicted: list[Box], targets: list[Box]) -> None:
    torch = pytest.importorskip("torch")
    boxes = [torch.tensor(np.array(found, np.float64).reshape(-1, 2, 3)) for found in (predicted, targets)]
    theirs = metric._eval_st_or_mt(*boxes) if targets else metric._eval_zt(boxes[0])
    for percent, value in zip(F1_PERCENTS, theirs, strict=True):
        # Where assignments tie, either may be found; a box IoU of exactly the threshold is theirs less an epsilon.
        if len(_by_rule(predicted, targets, percent / 100)) == 1 and not _touches(predicted, targets, percent / 100):
            assert _ours(predicted, targets, percent) == pytest.approx(float(value))


def _touches(predicted: list[Box], targets: list[Box], least: float) -> bool:
    return any(abs(_box_iou(a, b) - least) < 1e-6 for a in predicted for b in targets)


def test_f1_counts_an_iou_of_exactly_the_threshold() -> None:
    assert f1_score([0.25], 1, 1, 25) == 1.0
    assert f1_score([0.2499], 1, 1, 25) == 0.0


def test_f1_leftovers_of_either_side_cost() -> None:
    assert f1_score([0.9], 3, 1, 50) == 0.5
    assert f1_score([0.9], 1, 3, 50) == 0.5
    assert f1_score([], 0, 2, 25) == 0.0


def test_f1_without_targets_is_one_only_for_no_prediction() -> None:
    assert [f1_score([], count, 0, 25) for count in (0, 1, 4)] == [1.0, 0.0, 0.0]
    assert [zero_target_score(count) for count in (0, 1)] == [1.0, 0.0]


def test_f1_refuses_pairs_that_cannot_be() -> None:
    with pytest.raises(ValueError, match="2 pairs of 1 predictions"):
        f1_score([0.5, 0.5], 1, 3, 25)
    with pytest.raises(ValueError, match="above 0"):
        f1_score([0.0], 1, 1, 0)
