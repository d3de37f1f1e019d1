"""Lossy knobs: off by default, each as the reference has it, and the loss each one promises."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.render import EXACT, FAST, OUTPUTS, PRESETS, RenderQuality, prepare, render, render_reference, visible_ids
from pipeline.render.scaling import bilinear
from tests.render.scenes import assert_matches, assert_same_bits, camera, front_camera, gaussians, psnr_db, random_scene

KNOBS = [
    RenderQuality(scale=0.5),
    RenderQuality(scale=0.37),
    RenderQuality(sh_degree=0),
    RenderQuality(min_opacity=0.3),
    RenderQuality(alpha_min=0.05),
    RenderQuality(transmittance_stop=0.02),
    RenderQuality(transmittance_stop=0.3),
    FAST,
]


def test_exact_is_the_default_and_gives_nothing_up() -> None:
    scene, view = random_scene(1), camera()
    assert PRESETS == {"exact": EXACT, "fast": FAST}
    assert_same_bits(render(scene, view), render(scene, view, quality=EXACT))
    np.testing.assert_array_equal(EXACT.limits(), np.array([-np.log2(255.0), 0.0], np.float32))
    assert EXACT.camera(view) is view


@pytest.mark.parametrize("quality", KNOBS, ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_each_knob_matches_the_reference_and_changes_the_image(quality: RenderQuality, seed: int) -> None:
    scene, view = random_scene(seed, sh_degree=2), camera(97, 61)
    found = render(scene, view, quality=quality)
    assert_matches(found, render_reference(scene, view, quality=quality))
    assert 10 < psnr_db(found.color, render(scene, view).color) < 80


@pytest.mark.parametrize("quality", KNOBS, ids=str)
def test_each_knob_keeps_the_dominance_path_equal_and_threads_without_effect(quality: RenderQuality) -> None:
    prepared, view = prepare(random_scene(5, 600)), camera(130, 90)
    full = render(prepared, view, quality=quality)
    only = render(prepared, view, ("dominant",), quality=quality)
    np.testing.assert_array_equal(only.dominant, full.dominant)
    np.testing.assert_array_equal(only.dominant_weight, full.dominant_weight)
    assert_same_bits(full, render(prepared, view, quality=quality, threads=3))
    np.testing.assert_array_equal(
        visible_ids(prepared, view, quality=quality), np.unique(full.dominant[full.dominant >= 0])
    )


@pytest.mark.parametrize("stop", [0.01, 0.1, 0.5])
def test_a_stopped_pixel_loses_less_alpha_than_the_stop(stop: float) -> None:
    scene, view = random_scene(6, 2000), camera()
    exact, found = render(scene, view), render(scene, view, quality=RenderQuality(transmittance_stop=stop))
    lost = exact.alpha - found.alpha
    assert lost.min() >= 0
    assert stop / 10 < lost.max() < stop


@pytest.mark.parametrize("draw", [render, render_reference])
def test_the_gaussian_that_ends_a_pixel_is_kept(draw) -> None:
    scene = gaussians([[0, 0, 2.0], [0, 0, 3.0], [0, 0, 4.0]], scales=1e4, opacity_logits=0.0)
    found = draw(scene, front_camera(5, 5), quality=RenderQuality(transmittance_stop=0.3))
    np.testing.assert_allclose(found.alpha, 0.75, atol=1e-6)


@pytest.mark.parametrize("draw", [render, render_reference])
def test_opacity_pruning_leaves_out_faint_gaussians_only(draw) -> None:
    scene = gaussians([[0, 0, 2.0], [0, 0, 3.0]], scales=1e4, opacity_logits=[-1.0, 1.0])
    alone = draw(scene.take(slice(1, 2)), front_camera(5, 5))
    found = draw(scene, front_camera(5, 5), quality=RenderQuality(min_opacity=0.5))
    np.testing.assert_array_equal(found.alpha, alone.alpha)


def test_a_larger_cut_off_shrinks_a_footprint_to_its_ellipse() -> None:
    scene = gaussians([[0, 0, 4.0]], scales=0.3, opacity_logits=np.inf)
    found = render(scene, front_camera(), ("alpha",), quality=RenderQuality(alpha_min=0.1)).alpha
    y, x = np.mgrid[:33, :33] - 16
    np.testing.assert_array_equal(found > 0, np.exp(-0.5 * (x * x + y * y) / (3.0**2 + 0.3)) >= 0.1)


@pytest.mark.parametrize("scale", [0.5, 0.3, 0.01])
def test_a_scaled_frame_has_the_size_and_types_asked_for(scale: float) -> None:
    view = camera(45, 31)
    found, exact = (render(random_scene(7), view, quality=q) for q in (RenderQuality(scale=scale), EXACT))
    for name in found.__slots__:
        assert getattr(found, name).shape == getattr(exact, name).shape
        assert getattr(found, name).dtype == getattr(exact, name).dtype
    np.testing.assert_array_equal(found.dominant >= 0, found.dominant_weight > 0)
    one = render(random_scene(7), view, ("depth",), quality=RenderQuality(scale=scale))
    np.testing.assert_array_equal(one.depth, found.depth)
    assert one.color is None


def test_bilinear_keeps_linear_ramps_and_constants() -> None:
    ramp = (np.arange(8, dtype=np.float32) + 0.5)[None, :, None].repeat(4, axis=0)
    wide = bilinear(ramp, 16, 12)
    np.testing.assert_allclose(wide[:, 1:-1, 0], np.broadcast_to((np.arange(1, 15) + 0.5) / 2, (12, 14)), atol=1e-6)
    np.testing.assert_array_equal(bilinear(np.full((3, 1, 2), 0.3, np.float32), 7, 5), np.float32(0.3))


@pytest.mark.parametrize(
    "values",
    [
        {"scale": 0.0},
        {"scale": 1.5},
        {"alpha_min": 0.001},
        {"alpha_min": 0.99},
        {"transmittance_stop": 1.0},
        {"min_opacity": -0.1},
        {"sh_degree": 4},
        {"tile": 8},
    ],
    ids=str,
)
def test_knobs_out_of_range_are_refused(values: dict) -> None:
    with pytest.raises(ValidationError):
        RenderQuality(**values)


def test_quality_degree_only_lowers_what_is_asked_for() -> None:
    scene, view = random_scene(8, sh_degree=2), camera()
    assert_same_bits(render(scene, view, quality=RenderQuality(sh_degree=1)), render(scene, view, sh_degree=1))
    assert_same_bits(
        render(scene, view, OUTPUTS, sh_degree=1, quality=RenderQuality(sh_degree=2)), render(scene, view, sh_degree=1)
    )
