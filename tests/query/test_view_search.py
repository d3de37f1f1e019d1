from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geometry import Camera
from pipeline.query import view_search
from pipeline.query.initial_views import InitialView, initial_views
from pipeline.query.view_bounds import ClusterInViews
from pipeline.query.view_search import best_of_top, best_views, builds_whole, search
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex
from pipeline.render import PreparedGaussians, prepare
from pipeline.scene.load import load_scene
from pipeline.scene.procedural import build_apartment
from tests.query.test_visibility import random_camera, random_gaussians
from tests.query.tiny import tiny_scene

Clusters = Sequence[np.ndarray]


def _index(gaussians: PreparedGaussians, cameras: Sequence[Camera], **config: object) -> VisibilityIndex:
    return VisibilityIndex(gaussians, cameras, VisibilityConfig.model_validate({"build": "lazy", **config}))


def _targets(index: VisibilityIndex, clusters: Clusters, weights: np.ndarray | None = None) -> list[ClusterInViews]:
    return [ClusterInViews(index, cluster, weights) for cluster in clusters]


def _compare(index: VisibilityIndex, whole: VisibilityIndex, clusters: Clusters, weights: np.ndarray | None) -> None:
    """Hold the search to the full evaluation, bit for bit."""
    assert best_views(_targets(index, clusters, weights)) == initial_views(whole.counts(clusters, weights))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 150), views=st.integers(1, 7), weighted=st.booleans())
def test_search_equals_full_evaluation_on_random_scenes(seed: int, count: int, views: int, weighted: bool) -> None:
    rng = np.random.default_rng(seed)
    cameras = [random_camera(rng, largest=90) for _ in range(views)]
    cameras += [cameras[0]] * int(rng.integers(0, 3))  # equal views: the lowest number wins
    gaussians = prepare(random_gaussians(count, rng))
    weights = np.exp(rng.normal(0, 6, count)) * (rng.random(count) < 0.9) if weighted else None
    index, whole = _index(gaussians, cameras), _index(gaussians, cameras)
    for _ in range(2):  # later questions find tiles that earlier ones rendered
        picks = [rng.permutation(count)[: rng.integers(1, count + 1)] for _ in range(int(rng.integers(1, 4)))]
        _compare(index, whole, [pick.astype(np.int32) for pick in picks], weights)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 150), weighted=st.booleans())
def test_bounds_hold_whatever_was_rendered_and_end_exact(seed: int, count: int, weighted: bool) -> None:
    rng = np.random.default_rng(seed)
    index = _index(prepare(random_gaussians(count, rng)), [random_camera(rng, largest=90)])
    cluster = np.flatnonzero(rng.random(count) < 0.5).astype(np.int32)
    weights = np.exp(rng.normal(0, 6, count)) if weighted else None
    target = ClusterInViews(index, cluster, weights)
    truth = np.intersect1d(_index(index.gaussians, index.cameras).ids(0), cluster)
    amount = target.amount(truth.astype(np.int32))
    reach = target.reach(0)
    assert amount <= (0 if reach is None else reach.most)
    rows, columns = index.tiles(0)
    before = np.inf
    for _ in range(4):
        prospect = target.prospect(0)
        assert set(prospect.found) <= set(truth)
        assert amount <= prospect.most <= before * (1 + 1e-8)
        if not prospect.open.any():
            assert (prospect.most, prospect.found.tolist()) == (amount, truth.tolist())
        before = prospect.most
        left, top = int(rng.integers(columns)), int(rng.integers(rows))
        index.show(0, (left, top, int(rng.integers(left, columns)) + 1, int(rng.integers(top, rows)) + 1))
    index.show(0, (0, 0, columns, rows))
    assert target.prospect(0).most == amount


@pytest.mark.parametrize(("seed", "rooms"), [(1, 1), pytest.param(3, 4, marks=pytest.mark.slow)])
def test_search_equals_full_evaluation_in_apartments(seed: int, rooms: int) -> None:
    scene = build_apartment(seed, rooms=rooms, gaussians=5_000 * rooms, views=24, width=160, height=120).scene
    gaussians, cameras = prepare(scene.gaussians), [view.camera for view in scene.views]
    instance = scene.semantics.instance
    assert instance is not None
    numbers = np.random.default_rng(seed).permutation(np.unique(instance[instance >= 0]))[:12]
    clusters = [np.flatnonzero(instance == number).astype(np.int32) for number in numbers]
    index, whole = _index(gaussians, cameras), _index(gaussians, cameras)
    _compare(index, whole, clusters[:1], None)
    assert index.work.tiles < 0.5 * whole.work.tiles
    _compare(index, whole, clusters, None)
    assert index.work.frames < len(cameras)


def test_search_equals_full_evaluation_on_a_trained_scene(shared_data: Path) -> None:
    scene = load_scene(str(shared_data / "showroom"))
    gaussians, cameras = prepare(scene.gaussians), [view.camera for view in scene.views[::30]]
    means, rng = scene.gaussians.means, np.random.default_rng(0)
    centres = means[rng.choice(np.flatnonzero(scene.gaussians.opacity_logits > 0), 12)]
    near = (np.linalg.norm(means - centre, axis=1) < 0.4 for centre in centres)
    clusters = [np.flatnonzero(inside).astype(np.int32) for inside in near]
    index, whole = _index(gaussians, cameras), _index(gaussians, cameras)
    _compare(index, whole, clusters, None)
    _compare(index, whole, clusters, rng.random(len(means)))


def test_one_question_in_a_scene_of_many_views_renders_a_small_part_of_it() -> None:
    scene = tiny_scene()
    index = _index(prepare(scene.gaussians), [view.camera.resized(192, 144) for view in scene.views])
    assert scene.semantics.instance is not None
    table = np.flatnonzero(scene.semantics.instance == 2).astype(np.int32)
    search(ClusterInViews(index, table))
    rendered = index.work.tiles
    assert 0 < rendered < 0.5 * 6 * 12 * 9
    search(ClusterInViews(index, table))
    assert index.work.tiles == rendered, "nothing is rendered twice"


def test_a_hidden_cluster_and_one_without_weight_get_no_view() -> None:
    scene = tiny_scene()
    index = _index(prepare(scene.gaussians), [view.camera for view in scene.views])
    assert scene.semantics.instance is not None
    hidden, table = (np.flatnonzero(scene.semantics.instance == number).astype(np.int32) for number in (4, 2))
    assert search(ClusterInViews(index, hidden)) == InitialView(None, 0.0, 0)
    assert search(ClusterInViews(index, table, np.zeros(len(index.gaussians)))) == InitialView(None, 0.0, 0)


def test_the_whole_index_is_used_where_it_is_there_or_asked_for_or_cheaper(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = tiny_scene()
    gaussians, cameras = prepare(scene.gaussians), [view.camera for view in scene.views]
    one = [np.arange(3, dtype=np.int32)]
    assert not builds_whole(_targets(_index(gaussians, cameras), one))
    assert builds_whole(_targets(_index(gaussians, cameras, build="all"), one))
    built = _index(gaussians, cameras)
    built.build()
    assert builds_whole(_targets(built, one))
    everything = [np.arange(len(gaussians), dtype=np.int32)] * 20
    assert builds_whole(_targets(_index(gaussians, cameras, build="auto"), everything))
    monkeypatch.setattr(view_search, "LAZY_SHARE", 1e6)
    assert not builds_whole(_targets(_index(gaussians, cameras, build="auto"), everything))


def test_auto_costs_little_more_than_a_whole_index_however_many_questions_come() -> None:
    scene = tiny_scene()
    cameras = [view.camera.resized(384, 288) for view in scene.views] * 5
    index = _index(prepare(scene.gaussians), cameras, build="auto")
    for member in np.random.default_rng(0).integers(0, len(index.gaussians), 60):
        best_views(_targets(index, [np.array([member], np.int32)]))
    assert index.missing == 0
    assert 0 < index.work.searching <= view_search.LAZY_SHARE * len(index)
    assert index.work.windows > 0
    assert index.work.frames <= len(index)


def test_best_of_top_scores_the_views_another_pass_found_best() -> None:
    scene = tiny_scene()
    gaussians, cameras = prepare(scene.gaussians), [view.camera for view in scene.views]
    assert scene.semantics.instance is not None
    clusters = [np.flatnonzero(scene.semantics.instance == number).astype(np.int32) for number in range(5)]
    coarse = _index(gaussians, cameras, long_side=24).counts(clusters)
    exact = _index(gaussians, cameras).counts(clusters)
    for top in (1, 2, 6):
        chosen = best_of_top(_targets(_index(gaussians, cameras), clusters), coarse, top)
        for row, view in enumerate(chosen):
            tried = np.argsort(-coarse.scores[row], kind="stable")[:top]
            assert view.visible == exact.visible[row, tried].max()
            assert view.view in tried if view.visible else view.view is None
