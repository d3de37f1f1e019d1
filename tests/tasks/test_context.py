from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.config import MethodConfig
from pipeline.metrics.volume import volumes
from pipeline.query.initial_views import initial_views
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex
from pipeline.render import prepare
from pipeline.tasks.context import SceneContext
from tests.query.tiny import tiny_scene

SCENE = tiny_scene()


def _config(score: str = "visibility", **visibility: Any) -> MethodConfig:
    return MethodConfig.model_validate({"visibility": visibility, "initial_views": {"score": score}})


def _whole(**visibility: Any) -> VisibilityIndex:
    cameras = [view.camera for view in SCENE.views]
    return VisibilityIndex(prepare(SCENE.gaussians), cameras, VisibilityConfig(**visibility))


@pytest.mark.parametrize("build", ["lazy", "auto", "all"])
@pytest.mark.parametrize("score", ["visibility", "volume"])
def test_found_clusters_get_the_views_of_the_full_evaluation(build: str, score: str) -> None:
    context, config = SceneContext(SCENE), _config(score, build=build)
    weights = volumes(SCENE.gaussians.log_scales, SCENE.gaussians.opacity_logits) if score == "volume" else None
    for category in ("chair", "table"):
        expected = initial_views(_whole().counts(context.clusters(category, config), weights))
        assert tuple(found.initial for found in context.found_clusters(category, config)) == expected


def test_scores_do_not_share_what_was_found() -> None:
    context = SceneContext(SCENE)
    by_count = context.found_clusters("chair", _config())
    assert context.found_clusters("chair", _config("volume")) is not by_count
    assert context.found_clusters("chair", _config()) is by_count


def test_top_views_of_a_reduced_pass_are_scored_at_full_size() -> None:
    context, config = SceneContext(SCENE), _config(long_side=24, exact_top=2)
    assert context.builds_index(["chair"], config)
    exact, coarse = _whole(), _whole(long_side=24)
    clusters = context.clusters("chair", config)
    for found, full, reduced in zip(
        context.found_clusters("chair", config), exact.counts(clusters).visible, coarse.counts(clusters).visible,
        strict=True,
    ):  # fmt: skip
        top = [view for view in np.argsort(-reduced, kind="stable")[:2] if reduced[view]]
        assert found.initial.visible == max(full[top], default=0)
    assert not context.builds_index(["chair"], config)


def test_the_whole_index_is_asked_for_only_where_it_is_needed_and_missing() -> None:
    context = SceneContext(SCENE)
    assert context.builds_index(["table"], _config(build="all"))
    assert not context.builds_index(["table"], _config(build="lazy"))
    assert context.index(_config(build="lazy").visibility).work.tiles == 0, "asking renders nothing"
    context.found_clusters("table", _config(build="lazy"))
    assert context.index(_config(build="lazy").visibility).work.tiles > 0
    context.index(_config(build="all").visibility).build()
    assert not context.builds_index(["table"], _config(build="all"))
