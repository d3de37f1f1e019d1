from __future__ import annotations

import numpy as np
import pytest

from pipeline.metrics.iou import weighted_iou
from pipeline.metrics.volume import Weighting, gaussian_weights, volumes


def _random(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(-4, 1, (count, 3)).astype(np.float32), rng.normal(0, 3, count).astype(np.float32)


def test_volume_is_the_product_of_scales_and_opacity() -> None:
    log_scales, logits = _random(200)
    scales, opacity = np.exp(log_scales.astype(np.float64)), 1 / (1 + np.exp(-logits.astype(np.float64)))
    expected = [s[0] * s[1] * s[2] * a for s, a in zip(scales, opacity, strict=True)]
    np.testing.assert_allclose(volumes(log_scales, logits), expected, rtol=1e-12)


def test_flat_transparent_and_solid_gaussians_have_exact_volumes() -> None:
    log_scales = np.array([[-np.inf, 0, 0], [0, 0, 0], [0, 0, 0]], np.float32)
    logits = np.array([5, -np.inf, np.inf], np.float32)
    assert volumes(log_scales, logits).tolist() == [0.0, 0.0, 1.0]


def test_weights_are_one_from_the_90th_percentile_up_and_proportional_below() -> None:
    log_scales, logits = _random(1001)
    volume, weights = volumes(log_scales, logits), gaussian_weights(log_scales, logits)
    ninetieth = np.sort(volume)[900]
    assert (weights[volume >= ninetieth] == 1).all()
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights[volume < ninetieth], volume[volume < ninetieth] / ninetieth)


def test_one_huge_floater_does_not_change_the_other_weights() -> None:
    log_scales, logits = _random(1000)
    before = gaussian_weights(log_scales, logits)
    log_scales[np.argmax(before)] = 5
    np.testing.assert_array_equal(gaussian_weights(log_scales, logits), before)


def test_lightgaussian_weights_flatten_volumes_without_opacity() -> None:
    log_scales, logits = _random(1001)
    weights = gaussian_weights(log_scales, logits, "lightgaussian")
    raw = np.exp(log_scales.astype(np.float64).sum(axis=1))
    tenth = np.sort(raw)[100]
    np.testing.assert_allclose(weights, np.minimum(raw / tenth, 1) ** 0.1)
    np.testing.assert_array_equal(weights, gaussian_weights(log_scales, -logits, "lightgaussian"))


def test_no_gaussian_gives_no_weight() -> None:
    assert gaussian_weights(np.zeros((0, 3), np.float32), np.zeros(0, np.float32)).shape == (0,)


@pytest.mark.parametrize("solid", [0, 1, 3])
def test_where_the_reference_volume_is_zero_only_gaussians_with_a_volume_weigh(solid: int) -> None:
    log_scales = np.full((100, 3), -np.inf, np.float32)
    log_scales[:solid] = -2
    weights = gaussian_weights(log_scales, np.zeros(100, np.float32))
    assert weights.tolist() == [1.0] * solid + [0.0] * (100 - solid)


@pytest.mark.parametrize("weighting", ["percentile", "lightgaussian"])
def test_unlabelled_gaussians_weigh_nothing_and_leave_the_other_weights_alone(weighting: Weighting) -> None:
    log_scales, logits = _random(500)
    before = gaussian_weights(log_scales, logits, weighting)
    instance = np.arange(500, dtype=np.int32) % 5 - 1
    weights = gaussian_weights(log_scales, logits, weighting, instance)
    assert (weights[instance < 0] == 0).all()
    np.testing.assert_array_equal(weights[instance >= 0], before[instance >= 0])
    # A prediction that covers them, too, loses nothing; one that covers another instance does.
    target, unlabelled, other = (np.flatnonzero(instance == name) for name in (2, -1, 1))
    assert weighted_iou(np.concatenate([target, unlabelled]), target, weights) == 1.0
    assert weighted_iou(np.concatenate([target, other]), target, weights) < 0.9
