"""Gaussians and lenses that break renderers: each case by name, held to the reference or to the right answer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.render import render, render_reference
from pipeline.scene.gaussians import Gaussians
from tests.render.scenes import assert_matches, camera, front_camera, gaussians, psnr_db, random_scene


def _around_x(degrees: float) -> tuple[float, float, float, float]:
    return (float(np.cos(np.radians(degrees) / 2)), float(np.sin(np.radians(degrees) / 2)), 0.0, 0.0)


def _around_z(degrees: float) -> tuple[float, float, float, float]:
    return (float(np.cos(np.radians(degrees) / 2)), 0.0, 0.0, float(np.sin(np.radians(degrees) / 2)))


CASES = {
    "needle at 45 degrees": gaussians([[0.1, 0, 3.0]], scales=[1000.0, 1e-6, 1e-6], quats=_around_z(45)),
    "short needle at 45 degrees": gaussians([[0.1, 0, 3.0]], scales=[1.0, 1e-6, 1e-6], quats=_around_z(45)),
    "needle at 1 degree": gaussians([[0.1, 0, 3.0]], scales=[1000.0, 1e-6, 1e-6], quats=_around_z(1)),
    "needle along the view axis": gaussians([[0.1, 0.05, 3.0]], scales=[1e-6, 1e-6, 10.0]),
    "axis-aligned": gaussians([[0.0, 0, 3.0]], scales=[0.3, 0.1, 0.2]),
    "flat disc, edge on": gaussians([[0.0, 0.1, 3.0]], scales=[1.0, 0.0, 1.0]),
    "flat disc, tilted": gaussians([[0.0, 0.1, 3.0]], scales=[0.5, 0.0, 0.5], quats=_around_x(30)),
    "point of no size": gaussians([[0.05, 0.02, 3.0]], scales=0.0, opacity_logits=np.inf),
    "a thousand kilometres wide": gaussians([[0.3, 0.1, 3.0]], scales=1e6, opacity_logits=0.0),
    "largest scale accepted": gaussians([[0.3, 0.1, 3.0]], scales=5e34, opacity_logits=0.0),
    "opacity exactly 1, stacked": gaussians([[0, 0, 2.0 + k / 10] for k in range(9)], opacity_logits=np.inf),
    "opacity exactly 0": gaussians([[0, 0, 2.0]], opacity_logits=-np.inf),
    "opacity just under 1/255": gaussians([[0, 0, 2.0]], opacity_logits=np.log(1 / 254.2)),
    "opacity just over 1/255": gaussians([[0, 0, 2.0]], opacity_logits=np.log(1 / 253.0)),
    "huge quaternion": gaussians([[0, 0, 3.0]], scales=[0.5, 0.1, 0.1], quats=np.array(_around_z(30)) * 1e25),
    "tiny quaternion": gaussians([[0, 0, 3.0]], scales=[0.5, 0.1, 0.1], quats=np.array(_around_z(30)) * 1e-25),
    "mean at the camera centre": gaussians([[0, 0, 0.0]], scales=0.5),
    "mean on the near plane": gaussians([[0, 0, 0.2]], scales=0.1),
    "just behind the near plane": gaussians([[0, 0, 0.2001]], scales=0.05),
    "behind the camera": gaussians([[0, 0, -3.0]], scales=5.0),
    "long and outside the frustum": gaussians([[9.0, 0, 3.0]], scales=[4.0, 0.1, 0.1], opacity_logits=3.0),
    "far outside the clamp": gaussians([[30.0, 0.2, 1.0]], scales=6.0, opacity_logits=3.0),
    "colours of 1e4": gaussians([[0, 0, 3.0], [0.1, 0, 4.0]], colors=[[1e4, -1e4, 0], [0, 1e4, -1e4]]),
    "equal depths": gaussians([[x / 10, 0, 3.0] for x in range(-5, 5)], colors=np.eye(3)[np.arange(10) % 3]),
    "mean at the edge of float32": gaussians([[0, 0, 1e30], [1e30, 0, 3.0]], scales=1e20),
    "no Gaussians": gaussians(np.empty((0, 3))),
}
"""Scenes seen from the origin along +z."""


@pytest.mark.parametrize("name", CASES)
def test_render_degenerate_gaussians_matches_reference(name: str) -> None:
    scene, view = CASES[name], front_camera(45, 39)
    found, truth = render(scene, view), render_reference(scene, view)
    assert np.isfinite(found.color).all()
    scale = max(1.0, float(np.abs(truth.color).max()))
    assert psnr_db(found.color / scale, truth.color / scale) >= 90.0
    assert psnr_db(found.alpha, truth.alpha) >= 90.0
    # Single Gaussians: a rim pixel may fall on either side of 1/255.
    assert np.mean(found.dominant != truth.dominant) <= 2e-3


@pytest.mark.parametrize(
    "name", ["opacity exactly 0", "opacity just under 1/255", "behind the camera", "mean at the camera centre",
             "mean on the near plane", "no Gaussians"],
)  # fmt: skip
def test_render_of_what_cannot_be_seen_is_empty(name: str) -> None:
    found = render(CASES[name], front_camera(), background=(0.25, 0.5, 0.75))
    assert (found.dominant == -1).all()
    assert (found.alpha == 0).all()
    assert (found.depth == 0).all()
    assert (found.dominant_weight == 0).all()
    np.testing.assert_array_equal(found.color, np.broadcast_to(np.float32([0.25, 0.5, 0.75]), (33, 33, 3)))


def test_a_disc_without_end_covers_every_pixel() -> None:
    found = render(CASES["largest scale accepted"], front_camera())
    np.testing.assert_allclose(found.alpha, 0.5, atol=1e-6)


def test_needle_at_45_degrees_lights_the_diagonal() -> None:
    alpha = render(CASES["needle at 45 degrees"], front_camera(45, 39)).alpha
    lit = np.argwhere(alpha > 0.5)
    assert len(lit) > 30
    assert np.ptp(lit[:, 0] - lit[:, 1]) <= 2


def test_twenty_thousand_faint_layers_add_up() -> None:
    """Each has alpha 0.004 where it is centred; the sum must follow 1 - (1 - a)^n until the pixel stops."""
    count = 20_000
    means = np.column_stack([np.zeros((count, 2)), np.linspace(2.0, 40.0, count)])
    scene = gaussians(means, scales=1e3, opacity_logits=np.log(0.004 / 0.996))
    found = render(scene, front_camera(3, 3))
    truth = render_reference(scene, front_camera(3, 3))
    np.testing.assert_allclose(found.alpha, truth.alpha, atol=2e-6)
    np.testing.assert_allclose(found.depth, truth.depth, rtol=1e-4)
    assert found.alpha[1, 1] > 0.9998


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
