"""The dominance-only path, ties, permutations and occlusion: laws that hold exactly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.render import category_image, prepare, render, render_reference, visible_ids
from pipeline.scene.gaussians import Gaussians
from tests.render.scenes import assert_same_bits, camera, front_camera, gaussians, random_scene


@given(seed=st.integers(0, 2**31), count=st.integers(1, 400), opacity=st.floats(-4, 8))
@settings(max_examples=40, deadline=None)
def test_dominance_only_equals_the_full_path_exactly(seed: int, count: int, opacity: float) -> None:
    scene = random_scene(seed, count, sh_degree=0)
    scene = Gaussians(
        scene.means, scene.quats, scene.log_scales, (scene.opacity_logits + np.float32(opacity)), scene.sh
    )
    prepared, view = prepare(scene), camera(80, 48)
    full, only = render(prepared, view), render(prepared, view, ("dominant",))
    np.testing.assert_array_equal(only.dominant, full.dominant)
    np.testing.assert_array_equal(only.dominant_weight, full.dominant_weight)
    assert only.color is None
    assert only.depth is None
    assert only.alpha is None


@given(seed=st.integers(0, 2**31))
@settings(max_examples=20, deadline=None)
def test_permuted_gaussians_give_the_same_image_and_permuted_ids(seed: int) -> None:
    scene, view = random_scene(seed, 200), camera()
    order = np.random.default_rng(seed).permutation(len(scene))
    one, other = render(scene, view), render(scene.take(order), view)
    np.testing.assert_array_equal(one.color, other.color)
    np.testing.assert_array_equal(one.depth, other.depth)
    np.testing.assert_array_equal(one.dominant, np.where(other.dominant >= 0, order[other.dominant], -1))


def test_equal_depths_are_taken_by_id_however_many_there_are() -> None:
    """More equal depths than an insertion sort would bear, in an order that memory does not follow."""
    count = 500
    rng = np.random.default_rng(0)
    means = np.column_stack([rng.uniform(-0.8, 0.8, (count, 2)), np.full(count, 2.0)])
    scene = gaussians(means, scales=0.3, opacity_logits=0.0, colors=rng.uniform(0, 1, (count, 3)))
    found, truth = render(scene, front_camera()), render_reference(scene, front_camera())
    np.testing.assert_allclose(found.color, truth.color, atol=2e-6)
    assert np.mean(found.dominant == truth.dominant) > 0.999


@pytest.mark.parametrize("draw", [render, render_reference])
def test_the_same_gaussian_twice_is_won_by_the_lower_id(draw) -> None:
    scene = gaussians([[0, 0, 2.0]] * 2, scales=0.3, opacity_logits=3.0)
    found = draw(scene, front_camera())
    assert set(np.unique(found.dominant)) <= {-1, 0}


@pytest.mark.parametrize("draw", [render, render_reference])
def test_a_weaker_gaussian_in_front_loses_to_a_stronger_one_behind(draw) -> None:
    scene = gaussians([[0, 0, 2.5], [0, 0, 2.0]], scales=40.0, opacity_logits=[9.0, -1.0])
    assert (draw(scene, front_camera()).dominant == 0).all()


def test_gaussians_behind_a_closed_wall_change_nothing() -> None:
    rng = np.random.default_rng(1)
    wall = [[x, y, 2.0 + layer * 0.1] for layer in range(3) for x in (-2, 0, 2) for y in (-2, 0, 2)]
    hidden = np.column_stack([rng.uniform(-3, 3, (200, 2)), rng.uniform(4, 9, 200)])
    front = gaussians(wall, scales=2.0, opacity_logits=12.0)
    both = gaussians(np.concatenate([wall, hidden]), scales=2.0, opacity_logits=12.0)
    assert_same_bits(render(front, front_camera()), render(both, front_camera()))


def test_gaussians_behind_or_outside_the_view_change_nothing() -> None:
    view = front_camera()
    rng = np.random.default_rng(2)
    ahead = gaussians(np.column_stack([rng.uniform(-1, 1, (50, 2)), rng.uniform(1, 5, 50)]), scales=0.2)
    outside = gaussians(
        np.concatenate(
            [
                np.column_stack([rng.uniform(-9, 9, (100, 2)), rng.uniform(-9, 0.19, 100)]),
                np.column_stack([rng.uniform(30, 60, (100, 2)), rng.uniform(1, 5, 100)]),
            ]
        ),
        scales=0.2,
    )
    both = Gaussians(
        *(
            np.concatenate([getattr(ahead, name), getattr(outside, name)])
            for name in ("means", "quats", "log_scales", "opacity_logits", "sh")
        )
    )
    assert render(ahead, view).alpha.max() > 0.5
    assert_same_bits(render(ahead, view), render(both, view))


def test_visible_ids_are_the_sorted_unique_dominant_ids() -> None:
    scene, view = random_scene(11), camera()
    found = visible_ids(scene, view)
    dominant = render_reference(scene, view).dominant
    assert found.dtype == np.int32
    np.testing.assert_array_equal(found, np.unique(dominant[dominant >= 0]))


def test_visible_ids_of_an_empty_view_is_empty() -> None:
    assert visible_ids(gaussians([[0, 0, -2.0]]), front_camera()).shape == (0,)


def test_category_image_maps_dominant_ids_and_keeps_minus_one() -> None:
    dominant = np.array([[0, 2], [-1, 1]], np.int32)
    found = category_image(dominant, np.array([5, -1, 7], np.int32))
    np.testing.assert_array_equal(found, [[5, 7], [-1, -1]])
    assert found.dtype == np.int32
    np.testing.assert_array_equal(category_image(np.full((2, 2), -1, np.int32), np.empty(0, np.int32)), -1)
