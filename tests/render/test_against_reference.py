"""The kernels against the float64 reference, over scenes, lenses and options; both against hand results."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry import Camera, look_at
from pipeline.render import prepare, render, render_reference
from tests.render.scenes import UP, assert_matches, camera, front_camera, gaussians, random_scene


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sh_degree", range(4))
def test_render_random_scene_matches_reference(seed: int, sh_degree: int) -> None:
    scene = random_scene(10 * seed + sh_degree, sh_degree=sh_degree)
    view = camera()
    found = render(prepare(scene), view, background=(0.2, 0.4, 0.6))
    assert_matches(found, render_reference(scene, view, background=(0.2, 0.4, 0.6)))


@pytest.mark.parametrize("size", [(1, 1), (37, 21), (16, 16), (17, 33), (160, 120)])
def test_render_any_image_size_matches_reference(size: tuple[int, int]) -> None:
    scene, view = random_scene(3), camera(*size)
    assert_matches(render(scene, view), render_reference(scene, view))


@pytest.mark.parametrize(
    "K",
    [
        [[90.0, 0, 20.0], [0, 60.0, 50.0], [0, 0, 1]],
        [[60.0, 0, -30.0], [0, 90.0, 32.0], [0, 0, 1]],
        [[60.0, 0, 130.0], [0, 60.0, 90.0], [0, 0, 1]],
        [[4.2, 0, 48.0], [0, 4.2, 32.0], [0, 0, 1]],
        [[900.0, 0, 48.0], [0, 900.0, 32.0], [0, 0, 1]],
    ],
    ids=["off-centre", "left of the image", "right of the image", "fov 170 degrees", "telephoto"],
)
def test_render_any_lens_matches_reference(K: list[list[float]]) -> None:
    scene = random_scene(5)
    view = Camera(np.array(K), look_at(np.array([3.0, 2, 1]), np.zeros(3), UP), 96, 64)
    assert_matches(render(scene, view), render_reference(scene, view))


def test_render_very_long_lens_matches_reference() -> None:
    scene = gaussians([[0, 0, 1000.0], [0.02, 0.01, 1001.0]], scales=0.02)
    view = front_camera(48, 32, focal=1e5)
    assert_matches(render(scene, view), render_reference(scene, view))


@pytest.mark.parametrize("offset", [(1e4, -1e4, 50.0), (1e5, 1e5, 1e5)])
def test_render_far_from_the_world_origin_matches_reference(offset: tuple[float, float, float]) -> None:
    scene = random_scene(6, offset=offset)
    eye = np.array(offset) + np.array([3.0, 2.0, 1.0])
    view = camera(eye=eye, target=offset)
    assert render(scene, view).alpha.max() > 0.9
    assert_matches(render(scene, view), render_reference(scene, view))


@pytest.mark.parametrize("near", [0.0, 0.2, 3.5])
def test_render_any_near_plane_matches_reference(near: float) -> None:
    scene, view = random_scene(7), camera(eye=(0.3, 0.2, 0.1), target=(1, 1, 0))
    assert_matches(render(scene, view, near=near), render_reference(scene, view, near=near))


def test_render_antialiased_matches_reference_and_differs_from_plain() -> None:
    scene, view = random_scene(8), camera(focal=20.0)
    found = render(scene, view, antialias=True)
    assert_matches(found, render_reference(scene, view, antialias=True))
    assert np.abs(found.color - render(scene, view).color).max() > 0.01


def test_render_lower_sh_degree_matches_reference_and_ignores_the_rest() -> None:
    scene, view = random_scene(9, sh_degree=3), camera()
    found = render(scene, view, sh_degree=1)
    assert_matches(found, render_reference(scene, view, sh_degree=1))
    assert np.abs(found.color - render(scene, view).color).max() > 0.01


def test_render_sloppy_rotation_matches_reference() -> None:
    """Poses are accepted with rows off by 1e-3: the centre then is not -R^T t."""
    scene, view = random_scene(10, offset=(50, 0, 0)), camera(eye=(53, 2, 1), target=(50, 0, 0))
    pose = np.array(view.world_to_camera)
    pose[0, :3] *= 1.0004
    sloppy = view.moved_to(pose)
    assert_matches(render(scene, sloppy), render_reference(scene, sloppy))


@pytest.mark.parametrize("draw", [render, render_reference])
def test_one_centred_gaussian_has_the_weight_the_formula_gives(draw) -> None:
    scene = gaussians([[0.0, 0, 4.0]], scales=0.2, opacity_logits=0.0, colors=(0.8, 0.3, 0.0))
    found = draw(scene, front_camera(), background=(0.0, 0.0, 1.0))
    # Variance (40 px * 0.2 m / 4 m)^2 + 0.3 px^2; pixel (18, 16) lies 2 px right of the centre.
    expected = 0.5 * np.exp(-0.5 * 4.0 / 4.3)
    assert found.alpha[16, 18] == pytest.approx(expected, rel=2e-6)
    assert found.dominant_weight[16, 18] == pytest.approx(expected, rel=2e-6)
    assert found.depth[16, 18] == pytest.approx(4.0, rel=1e-6)
    np.testing.assert_allclose(
        found.color[16, 18], [0.8 * expected, 0.3 * expected, 1.0 - expected], rtol=3e-6, atol=1e-7
    )
    assert found.dominant[16, 18] == 0
    assert found.dominant[0, 0] == -1
    assert found.depth[0, 0] == 0


@pytest.mark.parametrize("draw", [render, render_reference])
def test_two_layers_composite_front_to_back(draw) -> None:
    scene = gaussians(
        [[0, 0, 5.0], [0, 0, 2.0]],
        scales=[[5.0] * 3, [2.0] * 3],
        opacity_logits=[9.0, 0.0],
        colors=[(1, 0, 0), (0, 1, 0)],
    )
    found = draw(scene, front_camera())
    np.testing.assert_allclose(found.color[16, 16], [0.5 * 0.99, 0.5, 0.0], atol=1e-5)
    assert found.depth[16, 16] == pytest.approx((0.5 * 2 + 0.495 * 5) / 0.995, rel=1e-5)
    assert found.dominant[16, 16] == 1


@pytest.mark.parametrize("draw", [render, render_reference])
def test_a_pixel_stops_before_transmittance_falls_under_its_limit(draw) -> None:
    """0.01 after one, 1e-4 after two: the third would leave 1e-6 and is not added, nor is anything behind it."""
    scene = gaussians([[0, 0, 2.0], [0, 0, 3.0], [0, 0, 4.0], [0, 0, 5.0]], scales=9.0, opacity_logits=[9, 4, 9, -4])
    found = draw(scene, front_camera(), background=(1.0, 1.0, 1.0))
    second = 1 / (1 + np.exp(-4.0))
    assert found.alpha[16, 16] == pytest.approx(1 - 0.01 * (1 - second), abs=2e-7)


def test_color_is_not_cut_above_and_cut_at_zero_below() -> None:
    scene = gaussians([[0, 0, 2.0]], scales=9.0, opacity_logits=np.inf, colors=(7.0, -3.0, 0.5))
    np.testing.assert_allclose(render(scene, front_camera()).color[16, 16], [6.93, 0.0, 0.495], rtol=1e-6)
