"""The heaviest Gaussians and the label sums of every pixel: against the reference and by their laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.render import (
    Contributors,
    count_blends,
    heaviest_label,
    label_image,
    label_weights,
    label_weights_reference,
    labels,
    passes,
    prepare,
    render,
    top_contributors,
    top_contributors_reference,
)
from pipeline.render.workspace import WORKSPACE
from schemas.errors import InputError
from tests.render.scenes import camera, front_camera, gaussians, random_scene

LARGEST_WEIGHT_ERROR = 2e-5
"""Rounding of a product of many float32 transmittances; a flip of an alpha next to 1/255 is a thousand times larger."""
OUTLIERS = 1e-3
"""Share of values where such a flip, or two nearly equal weights in the other order, may differ."""


def _assert_matches(found: Contributors, truth: Contributors) -> None:
    assert found.ids.shape == truth.ids.shape
    assert (found.ids.dtype, found.weights.dtype) == (np.int32, np.float32)
    assert np.mean(found.ids != truth.ids) <= OUTLIERS
    assert np.mean(np.abs(found.weights - truth.weights) > LARGEST_WEIGHT_ERROR) <= OUTLIERS


def _some_labels(scene, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(-1, count, len(scene)).astype(np.int32)


@pytest.mark.parametrize("size", [(1, 1), (37, 21), (96, 64)])
@pytest.mark.parametrize(("k", "first"), [(1, None), (4, None), (45, None), (400, None), (3, 1), (5, 7), (45, 100)])
def test_contributors_match_the_reference(size: tuple[int, int], k: int, first: int | None) -> None:
    scene, view = random_scene(k), camera(*size)
    _assert_matches(
        top_contributors(scene, view, k, first=first), top_contributors_reference(scene, view, k, first=first)
    )


@pytest.mark.parametrize("options", [{"near": 3.5}, {"antialias": True}])
def test_contributors_take_the_options_of_render(options: dict) -> None:
    scene, view = random_scene(9), camera(focal=30.0)
    found = top_contributors(scene, view, 4, **options)
    _assert_matches(found, top_contributors_reference(scene, view, 4, **options))
    assert (found.ids != top_contributors(scene, view, 4).ids).any()


@given(seed=st.integers(0, 2**31), count=st.integers(1, 300), k=st.integers(1, 12))
@settings(max_examples=25, deadline=None)
def test_contributors_are_sorted_distinct_and_led_by_the_dominant_one(seed: int, count: int, k: int) -> None:
    prepared, view = prepare(random_scene(seed, count, sh_degree=0)), camera(50, 37)
    found, plain = top_contributors(prepared, view, k), render(prepared, view)
    np.testing.assert_array_equal(found.ids[..., 0], plain.dominant)
    np.testing.assert_array_equal(found.weights[..., 0], plain.dominant_weight)
    assert (np.diff(found.weights, axis=-1) <= 0).all()
    np.testing.assert_array_equal(found.ids >= 0, found.weights > 0)
    ordered = np.sort(found.ids, axis=-1)
    assert not ((np.diff(ordered, axis=-1) == 0) & (ordered[..., 1:] >= 0)).any()
    longer = top_contributors(prepared, view, k + 3)
    np.testing.assert_array_equal(longer.ids[..., :k], found.ids)


def test_all_contributors_of_a_pixel_add_up_to_its_alpha() -> None:
    prepared, view = prepare(random_scene(3, 200)), camera()
    found = top_contributors(prepared, view, 200)
    assert (found.ids[..., -1] == -1).all()
    np.testing.assert_allclose(found.weights.sum(axis=-1), render(prepared, view).alpha, atol=2e-6)


@pytest.mark.parametrize("draw", [top_contributors, top_contributors_reference])
def test_lists_run_from_heavy_to_light_and_first_cuts_by_depth(draw) -> None:
    scene = gaussians([[0, 0, 4.0], [0, 0, 3], [0, 0, 2]], scales=1e4, opacity_logits=[9.0, 0.0, -2.0])
    np.testing.assert_array_equal(draw(scene, front_camera(5, 5), 3).ids[2, 2], [1, 0, 2])
    np.testing.assert_array_equal(draw(scene, front_camera(5, 5), 3, first=2).ids[2, 2], [1, 2, -1])
    np.testing.assert_array_equal(draw(scene, front_camera(5, 5), 3, first=1).ids[2, 2], [2, -1, -1])


def test_weights_of_the_same_bits_are_listed_nearest_first() -> None:
    """200 faint layers in 24,576 pixels have 10^8 pairs of weights: some are equal. Ids run against depth."""
    rng = np.random.default_rng(0)
    means = np.column_stack([rng.uniform(-1, 1, (200, 2)), np.linspace(4, 2, 200)])
    scene = gaussians(means, scales=2.0, opacity_logits=rng.uniform(-5.0, -4.0, 200))
    found = top_contributors(scene, front_camera(192, 128, focal=80.0), 200)
    tied = (np.diff(found.weights, axis=-1) == 0) & (found.ids[..., 1:] >= 0)
    assert tied.any()
    assert (np.diff(found.ids, axis=-1)[tied] < 0).all()


def test_nothing_in_view_lists_nothing() -> None:
    found = top_contributors(gaussians([[0, 0, -1.0]]), front_camera(20, 9), 3)
    assert (found.ids == -1).all()
    assert (found.weights == 0).all()


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("byte", [0x00, 0x7F, 0xFF])
def test_slabs_bands_threads_and_old_memory_change_no_bit(
    threads: int, byte: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, view = random_scene(5, 600), camera(130, 90)
    prepared, of = prepare(scene), _some_labels(scene, 7)
    whole, sums = top_contributors(prepared, view, 5, first=9), label_weights(prepared, view, of, 7)
    image = label_image(prepared, view, of, 7)
    for name, value in (("BAND_TILES", 20), ("SMALLEST_SLAB", 50), ("SLAB_KEYS_PER_TILE", 0)):
        monkeypatch.setattr(passes, name, value)
    monkeypatch.setattr(labels, "BAND_BYTES", 1)
    WORKSPACE.fill(byte)
    part = top_contributors(prepared, view, 5, first=9, threads=threads)
    np.testing.assert_array_equal(whole.ids, part.ids)
    np.testing.assert_array_equal(whole.weights, part.weights)
    np.testing.assert_array_equal(sums, label_weights(prepared, view, of, 7, threads=threads))
    found = label_image(prepared, view, of, 7, threads=threads)
    np.testing.assert_array_equal(image.labels, found.labels)
    np.testing.assert_array_equal(image.weights, found.weights)


@pytest.mark.parametrize("arguments", [{"k": 0}, {"k": 2, "first": 0}, {"k": 2, "near": -1.0}, {"k": 2, "threads": 0}])
def test_bad_contributor_argument_is_an_input_error(arguments: dict) -> None:
    with pytest.raises(InputError, match=list(arguments)[-1]):
        top_contributors(random_scene(1, 5), camera(8, 8), **arguments)


@pytest.mark.parametrize("count", [1, 6, 40])
@pytest.mark.parametrize("size", [(1, 1), (37, 21), (96, 64)])
def test_label_sums_and_image_match_the_reference(size: tuple[int, int], count: int) -> None:
    scene, view = random_scene(count), camera(*size)
    of = _some_labels(scene, count)
    found, truth = label_weights(scene, view, of, count), label_weights_reference(scene, view, of, count)
    assert found.dtype == np.float32
    assert np.mean(np.abs(found - truth) > LARGEST_WEIGHT_ERROR) <= OUTLIERS
    image, best = label_image(scene, view, of, count), heaviest_label(truth)
    assert np.mean(image.labels != best.labels) <= OUTLIERS
    assert np.mean(np.abs(image.weights - best.weights) > LARGEST_WEIGHT_ERROR) <= OUTLIERS
    np.testing.assert_array_equal(image.labels, heaviest_label(found).labels)


def test_sums_over_all_labels_are_alpha_and_one_label_each_is_the_weight() -> None:
    scene, view = random_scene(8, 60), camera(50, 37)
    plain = render(scene, view)
    each = label_weights(scene, view, np.arange(60, dtype=np.int32), 60)
    np.testing.assert_allclose(each.sum(axis=-1), plain.alpha, atol=2e-6)
    np.testing.assert_array_equal(each.max(axis=-1), plain.dominant_weight)
    image = label_image(scene, view, np.arange(60, dtype=np.int32), 60)
    np.testing.assert_array_equal(image.labels, plain.dominant)


def test_many_light_gaussians_of_a_label_beat_one_heavier_of_another() -> None:
    """Weights .3 (label 1), then .28 and .21 (label 0): arg-max says 1, the sums 0. Unlabelled ones only hide."""
    means = [[0, 0, 2.0], [0, 0, 3], [0, 0, 4], [0, 0, 1.5]]
    opacities = np.array([0.3, 0.4, 0.5, 0.5])
    scene = gaussians(means, scales=1e4, opacity_logits=np.log(opacities / (1 - opacities)))
    of = np.array([1, 0, 0, -1], np.int32)
    image = label_image(scene, front_camera(5, 5), of, 2)
    assert (image.labels == 0).all()
    np.testing.assert_allclose(image.weights, 0.5 * 0.49, atol=1e-6)
    assert of[render(scene.take(slice(3)), front_camera(5, 5)).dominant[2, 2]] == 1


def test_pixels_without_a_labelled_gaussian_have_no_label() -> None:
    scene = gaussians([[0, 0, 2.0]], scales=0.05)
    image = label_image(scene, front_camera(), np.array([0], np.int32), 3)
    assert (image.labels[16, 16], image.labels[0, 0]) == (0, -1)
    assert image.weights[0, 0] == 0
    assert (label_image(scene, front_camera(), np.array([-1], np.int32), 3).labels == -1).all()


@pytest.mark.parametrize(
    ("of", "count", "field"),
    [([0, 1, 2], 2, "labels"), ([0, -2, 1], 2, "labels"), ([0], 2, "labels"), ([0] * 3, 0, "count")],
)
def test_bad_labels_are_an_input_error(of: list[int], count: int, field: str) -> None:
    scene = random_scene(1, 3)
    for draw in (label_weights, label_image, label_weights_reference):
        with pytest.raises(InputError, match=field):
            draw(scene, camera(8, 8), np.array(of, np.int32), count)


def test_blend_counts_are_those_of_the_reference() -> None:
    """Every pair is one place of the full lists; a vector has one to eight pairs; dominance needs fewer."""
    prepared, view = prepare(random_scene(4, 300)), camera()
    counts = count_blends(prepared, view)
    pairs = int((top_contributors(prepared, view, 300).ids >= 0).sum())
    assert counts.pixels == pairs
    assert pairs / 8 <= counts.contributing <= counts.vectors
    assert counts.contributing <= pairs
    dominance = count_blends(prepared, view, dominance=True)
    assert 0 < dominance.vectors < counts.vectors
