"""Every case of the stress list by name, held to its right answer; and scenes of random degenerate Gaussians."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pipeline.render import render, render_reference
from pipeline.scene.gaussians import Gaussians
from tests.render.scenes import assert_matches, camera, front_camera, gaussians, random_scene
from tests.render.stress_cases import Case, Outcome, all_cases
from tests.render.stress_gaussians import NEEDLE, Z45

CASES = [pytest.param(case, id=case.name, marks=[pytest.mark.slow] * case.slow) for case in all_cases()]


@pytest.mark.parametrize("case", CASES)
def test_stress_case_gives_the_right_answer(case: Case) -> None:
    assert case.run().failures() == []


@pytest.mark.parametrize(
    "outcome",
    [
        Outcome(1.0, 2.0, "by hand", 1.0, 0.5),
        Outcome(np.nan, 2.0, "by hand", np.nan, 0.5),
        Outcome(1.0, 1.0, "float64", 0.0, 0.5, rms=1e-4),
        Outcome(1.0, 1.0, "float64", 0.0, 0.5, rms=np.nan),
        Outcome(1.0, 1.0, "float64", 0.0, 0.5, flipped=0.01),
    ],
)
def test_outcome_over_a_limit_or_not_a_number_fails(outcome: Outcome) -> None:
    assert len(outcome.failures()) == 1


def test_case_names_are_distinct() -> None:
    names = [case.name for case in all_cases()]
    assert len(set(names)) == len(names) >= 29


def test_needle_at_45_degrees_lights_the_diagonal() -> None:
    scene = gaussians([[0.1, 0, 3.0]], scales=NEEDLE, quats=Z45)
    lit = np.argwhere(render(scene, front_camera(45, 39)).alpha > 0.5)
    assert len(lit) > 30
    assert np.ptp(lit[:, 0] - lit[:, 1]) <= 2


def _degenerate_scene(seed: int) -> Gaussians:
    """A few Gaussians, any number of which may be extreme."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 13))

    def mix(ordinary: np.ndarray, *special: float) -> np.ndarray:
        chosen = rng.choice(np.array(special), ordinary.shape)
        return np.where(rng.random(ordinary.shape) < 0.2, chosen, ordinary).astype(np.float32)

    return Gaussians(
        means=mix(rng.uniform(-3, 3, (count, 3)), 0.0, 0.2, 1e-6, 1e4, -1e4),
        quats=mix(rng.normal(size=(count, 4)), 0.0, 1e-30, 1e25, -1e25),
        log_scales=mix(rng.uniform(-8, 1, (count, 3)), -np.inf, -80.0, 12.0, 40.0, 79.0),
        opacity_logits=mix(rng.normal(0, 4, count), -np.inf, np.inf, 0.0, 80.0),
        sh=mix(rng.normal(0, 1, (count, 4, 3)), 1e4, -1e4),
    )


@given(seed=st.integers(0, 2**31), near=st.sampled_from([0.01, 0.2]))
@example(seed=10936, near=0.2)  # 2e34 m long, and 1e-25 off the line of sight
@settings(max_examples=60, deadline=None)
def test_render_any_degenerate_scene_is_finite_and_close_to_the_reference(seed: int, near: float) -> None:
    scene = _degenerate_scene(seed)
    view = front_camera(24, 18, focal=20.0)
    found, truth = render(scene, view, near=near), render_reference(scene, view, near=near)
    for image in (found.color, found.depth, found.alpha, found.dominant_weight):
        assert np.isfinite(image).all()
    assert (found.alpha >= 0).all()
    assert (found.alpha <= 1).all()
    # Needles without end leave float32 a few hundredths of a pixel of doubt: bound the share, not the maximum.
    assert np.mean(np.abs(found.alpha - truth.alpha) > 0.02) < 0.02
    np.testing.assert_array_equal(found.dominant >= 0, found.alpha > 0)
    assert set(np.unique(found.dominant)) <= {-1, *range(len(scene))}


def test_camera_far_away_sees_nothing_but_specks() -> None:
    scene, view = random_scene(12), camera(eye=(3e3, 2e3, 1e3))
    assert_matches(render(scene, view), render_reference(scene, view))
