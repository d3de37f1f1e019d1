"""Preparation: what is kept, how it is ordered, and that block culling never drops what a camera sees."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geometry import Camera, covariances, look_at
from pipeline.render import prepare, render_reference
from pipeline.render.culling import visible_blocks
from pipeline.render.lens import Lens
from pipeline.render.prepare import BLOCK, log2_sigmoid
from pipeline.render.window import Window
from pipeline.scene.gaussians import Gaussians
from tests.render.scenes import UP, gaussians, random_scene


def test_prepare_keeps_every_gaussian_once_but_those_never_seen() -> None:
    scene = gaussians(np.zeros((5, 3)), opacity_logits=[2.0, -np.inf, -5.6, -5.5, np.inf])
    prepared = prepare(scene)
    assert sorted(prepared.ids[prepared.ids >= 0]) == [0, 3, 4]
    assert len(prepared.ids) == BLOCK
    assert len(prepared) == 5


def test_prepared_axes_square_to_the_covariance() -> None:
    scene = random_scene(1, 300)
    prepared = prepare(scene)
    flat = np.swapaxes(prepared.geometry, 1, 2).reshape(-1, 13)[: (prepared.ids >= 0).sum()]
    ids = prepared.ids[prepared.ids >= 0]
    axes = flat[:, 3:12].reshape(-1, 3, 3).astype(np.float64)
    expected = covariances(scene.quats, scene.log_scales)[ids]
    np.testing.assert_allclose(np.swapaxes(axes, 1, 2) @ axes, expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_array_equal(flat[:, :3], scene.means[ids])


def test_neighbours_in_memory_are_neighbours_in_space() -> None:
    prepared = prepare(random_scene(2, 20_000, sh_degree=0))
    assert np.median(prepared.block_halves.max(axis=1)) < 0.7


@pytest.mark.parametrize(
    ("logit", "expected"), [(np.inf, 0.0), (-np.inf, -np.inf), (0.0, -1.0), (-80.0, -115.41560327)]
)
def test_log2_sigmoid_is_exact_at_its_ends(logit: float, expected: float) -> None:
    assert log2_sigmoid(np.array([logit], np.float32))[0] == pytest.approx(expected, rel=1e-9)


@given(
    seed=st.integers(0, 2**31),
    eye=st.tuples(*[st.floats(-4, 4)] * 3),
    focal=st.floats(4, 300),
    center=st.tuples(st.floats(-50, 150), st.floats(-50, 150)),
)
@settings(max_examples=40, deadline=None)
def test_block_culling_keeps_every_block_with_a_visible_gaussian(seed, eye, focal, center) -> None:
    rng = np.random.default_rng(seed)
    scene = random_scene(seed, 3 * BLOCK, sh_degree=0)
    scene = Gaussians(
        (scene.means * rng.uniform(0.1, 3)), scene.quats, scene.log_scales, scene.opacity_logits + 3, scene.sh
    )
    K = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1]])
    view = Camera(K, look_at(np.array(eye) + 1e-3, np.array([0.0, 0, 5.0]), UP), 60, 40)
    seen = np.unique(render_reference(scene, view, ("dominant",)).dominant)
    prepared = prepare(scene)
    kept = visible_blocks(prepared, Lens.of(view), Window.of(view), 0.2)
    kept_ids = prepared.ids.reshape(-1, BLOCK)[kept]
    assert set(seen) - {-1} <= set(kept_ids.ravel().tolist())


def test_block_culling_drops_what_lies_behind() -> None:
    means = np.random.default_rng(0).uniform(-1, 1, (4 * BLOCK, 3)) * 0.2 + np.repeat(
        [[0, 0, 3.0], [0, 0, -3.0], [50, 0, 3.0], [0, 0, -9.0]], BLOCK, axis=0
    )
    prepared = prepare(gaussians(means))
    view = Camera(np.array([[40.0, 0, 16], [0, 40, 16], [0, 0, 1]]), np.eye(3, 4), 32, 32)
    kept = visible_blocks(prepared, Lens.of(view), Window.of(view), 0.2)
    assert 1 <= len(kept) <= 2
