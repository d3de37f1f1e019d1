"""Table `clusterings`: one row a question and evidence category, from the clusters the method used."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from pipeline.baselines.registry import answer_question
from pipeline.config import MethodConfig
from pipeline.metrics.cluster_quality import ClusterQuality, cluster_quality
from pipeline.scene.scene import Scene
from pipeline.tasks.method import QuestionRows, SceneContext
from schemas.questions import Question
from tests.query.tiny import Scripted, caller_of, tiny_scene, without_instances

QUESTION = Question("q1", "tiny", "eqa", "what is there?", answer="a cup", category="k")


def _rows(scene: Scene, client: Scripted | None = None, **clustering: float) -> QuestionRows:
    config = MethodConfig.model_validate({"clustering": clustering})
    return asyncio.run(answer_question(SceneContext(scene), QUESTION, caller_of(client or Scripted({})), config))


def test_each_evidence_category_has_a_row_that_agrees_with_the_other_tables() -> None:
    rows = _rows(tiny_scene())
    answer = rows.answers[0]
    assert tuple(row.category for row in rows.clusterings) == answer.evidence == ("chair", "table", "wall")
    assert sum(row.activated for row in rows.clusterings) == answer.activated
    assert sum(row.clusters for row in rows.clusterings) == answer.clusters_found
    held = sum(cluster.gaussians for cluster in rows.clusters)
    assert sum(row.activated - row.dropped for row in rows.clusterings) == held


def test_three_chairs_apart_are_matched_one_by_one() -> None:
    chairs = _rows(tiny_scene()).clusterings[0]
    assert (chairs.instances, chairs.clusters, chairs.matched, chairs.ari) == (3, 3, 3, 1.0)
    assert (chairs.over_split, chairs.under_split, chairs.dropped) == (0, 0, 0)
    assert chairs.known == chairs.activated


def test_a_distance_that_merges_chairs_shows_in_the_row() -> None:
    chairs = _rows(tiny_scene(), epsilon_m=9.0).clusterings[0]
    assert (chairs.epsilon_m, chairs.clusters, chairs.under_split, chairs.matched) == (9.0, 1, 1, 0)
    assert chairs.ari == pytest.approx(0.0)


def test_without_ground_truth_the_scores_are_null_and_the_counts_stay() -> None:
    seen, blind = _rows(tiny_scene()).clusterings, _rows(without_instances(tiny_scene())).clusterings
    for with_truth, without in zip(seen, blind, strict=True):
        assert (without.activated, without.clusters, without.dropped, without.epsilon_m) == (
            with_truth.activated,
            with_truth.clusters,
            with_truth.dropped,
            with_truth.epsilon_m,
        )
        scores = (without.instances, without.ari, without.over_split, without.under_split, without.matched)
        assert (without.known, scores) == (0, (None,) * 5)


def test_a_question_without_evidence_clusters_nothing() -> None:
    rows = _rows(tiny_scene(), Scripted({"evidence": "none of these"}))
    assert rows.answers[0].status != "answered"
    assert rows.clusterings == ()


def test_measured_clusters_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def counted(truth: np.ndarray, predicted: np.ndarray) -> ClusterQuality:
        calls.append(len(truth))
        return cluster_quality(truth, predicted)

    monkeypatch.setattr("pipeline.tasks.context.cluster_quality", counted)
    context, config = SceneContext(tiny_scene()), MethodConfig()
    assert context.measured_clusters("chair", config) is context.measured_clusters("chair", config)
    assert len(calls) == 1
