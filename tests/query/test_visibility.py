from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geometry import Camera, look_at
from pipeline.metrics.volume import volumes
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex, dominant_ids, fitted_to, literal_visible
from pipeline.render import prepare, render, render_reference
from pipeline.scene.gaussians import Gaussians
from tests.query.tiny import UP, box_points, camera_at, gaussians_at, tiny_scene


def random_gaussians(count: int, rng: np.random.Generator) -> Gaussians:
    """Overlapping Gaussians of every shape and opacity, some behind the camera, some solid, some unseeable."""
    logits = rng.choice([-6.0, -2.0, 0.0, 2.0, 8.0, np.inf], count) + rng.normal(0, 1, count)
    return Gaussians(
        means=rng.normal(0, 1.2, (count, 3)).astype(np.float32),
        quats=rng.normal(size=(count, 4)).astype(np.float32),
        log_scales=rng.uniform(-4, 0, (count, 3)).astype(np.float32),
        opacity_logits=logits.astype(np.float32),
        sh=rng.normal(size=(count, 1, 3)).astype(np.float32),
    )


def random_camera(rng: np.random.Generator, largest: int = 24) -> Camera:
    width, height = (int(n) for n in rng.integers(4, largest, 2))
    focal = rng.uniform(4, 30, 2)
    K = np.array([[focal[0], 0, width * rng.uniform(0.3, 0.7)], [0, focal[1], height / 2], [0, 0, 1]])
    return Camera(K, look_at(rng.normal(0, 2.0, 3), rng.normal(0, 0.3, 3), UP), width, height)


@pytest.mark.parametrize("renderer", [render_reference, render], ids=["float64", "kernels"])
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 120))
def test_dominance_form_equals_the_literal_formula(renderer: object, seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    gaussians, camera = random_gaussians(count, rng), random_camera(rng)
    dominant = np.unique(renderer(gaussians, camera, outputs=("dominant",)).dominant)  # type: ignore[operator]
    labels = rng.integers(0, 4, count)
    for label in range(4):
        cluster = np.flatnonzero(labels == label)
        if len(cluster):
            literal = literal_visible(gaussians, cluster, camera, renderer=renderer)  # type: ignore[arg-type]
            np.testing.assert_array_equal(literal, np.intersect1d(dominant, cluster))


def test_index_scores_equal_the_literal_formula_in_every_view() -> None:
    scene = tiny_scene()
    cameras = [view.camera for view in scene.views]
    index = VisibilityIndex(prepare(scene.gaussians), cameras, VisibilityConfig())
    instance = scene.semantics.instance
    assert instance is not None
    clusters = [np.flatnonzero(instance == number).astype(np.int32) for number in range(5)]
    counts = index.counts(clusters)
    for row, cluster in enumerate(clusters):
        for view, camera in enumerate(cameras):
            literal = literal_visible(scene.gaussians, cluster, camera, renderer=render)
            assert counts.visible[row, view] == len(literal)
            assert counts.scores[row, view] == len(literal) / len(cluster)
    assert counts.visible[4].max() == 0, "a wall hides the last chair from every view"
    assert counts.visible[:4].max(axis=1).min() > 0


def test_views_are_rendered_when_asked_for_and_once() -> None:
    scene = tiny_scene()
    index = VisibilityIndex(prepare(scene.gaussians), [view.camera for view in scene.views], VisibilityConfig())
    assert (index.missing, index.nbytes) == (6, 0)
    first = index.ids(2)
    assert index.missing == 5
    assert index.ids(2) is first
    assert (np.diff(first) > 0).all()
    index.build()
    assert index.missing == 0
    assert index.ids(2) is first


def test_overlapping_clusters_are_each_counted_in_full() -> None:
    scene = tiny_scene()
    index = VisibilityIndex(prepare(scene.gaussians), [view.camera for view in scene.views], VisibilityConfig())
    everything = np.arange(len(scene.gaussians), dtype=np.int32)
    counts = index.counts([everything, everything[::2].copy(), everything])
    np.testing.assert_array_equal(counts.visible[0], [len(index.ids(view)) for view in range(6)])
    np.testing.assert_array_equal(counts.visible[0], counts.visible[2])
    assert (counts.visible[1] <= counts.visible[0]).all()


def test_volume_scores_equal_the_literal_formula_in_every_view() -> None:
    rng = np.random.default_rng(5)
    gaussians = random_gaussians(80, rng)
    cameras = [random_camera(rng) for _ in range(6)]
    cluster = np.sort(rng.permutation(80)[:40]).astype(np.int32)
    scales = np.exp(gaussians.log_scales.astype(np.float64))
    volume = scales[:, 0] * scales[:, 1] * scales[:, 2] / (1 + np.exp(-gaussians.opacity_logits.astype(np.float64)))
    weights = volumes(gaussians.log_scales, gaussians.opacity_logits)
    counts = VisibilityIndex(prepare(gaussians), cameras, VisibilityConfig()).counts([cluster], weights)
    for view, camera in enumerate(cameras):
        seen = literal_visible(gaussians, cluster, camera, renderer=render)
        assert counts.visible[0, view] == len(seen)
        assert counts.scores[0, view] == pytest.approx(volume[seen].sum() / volume[cluster].sum(), rel=1e-12)
    assert len(np.unique(counts.scores)) > 3


def test_a_cluster_without_volume_scores_zero() -> None:
    scene = tiny_scene()
    index = VisibilityIndex(prepare(scene.gaussians), [view.camera for view in scene.views], VisibilityConfig())
    counts = index.counts([np.arange(40, dtype=np.int32)], np.zeros(len(scene.gaussians)))
    assert (counts.scores == 0).all()
    assert counts.visible.max() > 0


def test_threads_change_no_row() -> None:
    scene = tiny_scene()
    one, two = (
        VisibilityIndex(prepare(scene.gaussians), [view.camera for view in scene.views], VisibilityConfig())
        for _ in range(2)
    )
    one.ids(3)
    one.build()
    two.build(threads=2)
    assert (one.work.frames, two.work.frames) == (6, 6)
    for view in range(6):
        np.testing.assert_array_equal(one.ids(view), two.ids(view))


def test_an_index_taken_over_whole_renders_nothing() -> None:
    scene = tiny_scene()
    cameras = [view.camera for view in scene.views]
    whole, taken = (VisibilityIndex(prepare(scene.gaussians), cameras, VisibilityConfig()) for _ in range(2))
    taken.adopt_transposed(whole.joined())
    assert taken.missing == 0
    cluster = [np.arange(0, len(scene.gaussians), 3, dtype=np.int32)]
    np.testing.assert_array_equal(taken.counts(cluster).visible, whole.counts(cluster).visible)
    for view in range(6):
        np.testing.assert_array_equal(taken.ids(view), whole.ids(view))
    assert taken.work.tiles == 0


def test_parts_of_a_view_add_up_to_its_row() -> None:
    scene = tiny_scene()
    camera = scene.views[5].camera.resized(192, 144)
    index, whole = (VisibilityIndex(prepare(scene.gaussians), [camera], VisibilityConfig()) for _ in range(2))
    index.show(0, (0, 0, 6, 4))
    part = index.part(0)
    assert (int(part.done.sum()), index.held(0)) == (24, None)
    assert 0 < len(part.ids) < len(whole.ids(0))
    assert set(part.ids) <= set(whole.ids(0))
    dominant = render(scene.gaussians, camera, outputs=("dominant",)).dominant
    assert dominant is not None
    np.testing.assert_array_equal(part.ids, dominant_ids(dominant[:64, :96], len(scene.gaussians)))
    index.show(0, (6, 0, 12, 9))
    np.testing.assert_array_equal(index.ids(0), whole.ids(0))
    assert index.part(0).done.all()


def test_many_parts_of_a_view_end_in_rendering_it_whole() -> None:
    scene = tiny_scene()
    index = VisibilityIndex(prepare(scene.gaussians), [scene.views[5].camera.resized(192, 144)], VisibilityConfig())
    for column in range(12):
        index.show(0, (column, 0, column + 1, 1))
    assert (index.missing, index.work.frames) == (0, 1)
    assert index.work.windows < 6


def test_views_a_policy_leaves_out_are_not_rendered_and_see_nothing() -> None:
    scene = tiny_scene()
    cameras = [view.camera for view in scene.views]
    index = VisibilityIndex(prepare(scene.gaussians), cameras, VisibilityConfig(every_nth=4))
    assert (index.views, index.missing) == ((0, 4), 2)
    counts = index.counts([np.arange(len(scene.gaussians), dtype=np.int32)])
    np.testing.assert_array_equal(counts.visible[0] > 0, [True, False, False, False, True, False])
    assert index.work.frames == 2


def test_pruned_gaussians_are_as_if_they_were_not_there() -> None:
    rng = np.random.default_rng(2)
    gaussians, camera = random_gaussians(100, rng), random_camera(rng, largest=60)
    kept = np.flatnonzero(1 / (1 + np.exp(-gaussians.opacity_logits.astype(np.float64))) >= 0.4)
    pruned = VisibilityIndex(prepare(gaussians), [camera], VisibilityConfig(min_opacity=0.4))
    alone = VisibilityIndex(prepare(gaussians.take(kept)), [camera], VisibilityConfig())
    assert 0 < len(kept) < 100
    np.testing.assert_array_equal(pruned.ids(0), kept[alone.ids(0)])


@given(seed=st.integers(0, 10_000), count=st.integers(1, 50))
def test_dominant_ids_are_the_distinct_ids_of_an_image(seed: int, count: int) -> None:
    dominant = np.random.default_rng(seed).integers(-1, count, (6, 5)).astype(np.int32)
    assert dominant_ids(dominant, count).tolist() == sorted(set(dominant.ravel().tolist()) - {-1})


def test_no_cluster_and_no_view_give_empty_tables() -> None:
    gaussians = prepare(gaussians_at(box_points((0, 3, 0), (0.2, 0.2, 0.2))))
    with_view = VisibilityIndex(gaussians, [camera_at((0, 0, 0), (0, 3, 0))], VisibilityConfig())
    assert with_view.counts([]).visible.shape == (0, 1)
    without = VisibilityIndex(gaussians, [], VisibilityConfig())
    assert without.counts([np.array([0, 1], np.int32)]).visible.shape == (1, 0)


def test_reduced_renders_keep_the_field_of_view() -> None:
    camera = camera_at((0, 0, 1), (0, 3, 1), 640, 480)
    small = fitted_to(camera, 160)
    assert (small.width, small.height) == (160, 120)
    point = np.array([[0.4, 3.0, 1.2]])
    np.testing.assert_allclose(small.project(point)[0] * 4, camera.project(point)[0])
    assert fitted_to(camera, None) is camera
    assert fitted_to(camera, 640) is camera
    assert fitted_to(camera, 2000) is camera
