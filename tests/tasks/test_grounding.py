"""Regions by name, on a scene of three chairs (one behind a wall) and a table."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pipeline.baselines.registry import answer_question
from pipeline.config import MethodConfig
from pipeline.query.cluster_scale import JOIN_EPSILONS, derived_epsilon
from pipeline.render import render
from pipeline.tasks.grounding import Grounder, ShownView, standing_for
from pipeline.tasks.method import QuestionRows, SceneContext
from pipeline.tasks.region import LOOKING, OF_CLUSTERS, GroundingConfig, RegionRule, frustum_region
from schemas.questions import Question, Task
from tests.query.tiny import Scripted, caller_of, camera_at, tiny_scene

CONFIG = MethodConfig()
BOTH = camera_at((0, -3, 1.5), (0, 3, 0.6))
"""Shows both chairs in the open and the table; the hidden chair lies in its frustum."""
LEFT = camera_at((-1.5, -0.5, 1.0), (-1.5, 2, 0.4))
"""Shows the left chair alone."""


class Chairs:
    """What a question about chairs activates."""

    def __init__(self) -> None:
        self.scene = tiny_scene()
        instance = self.scene.semantics.instance
        assert instance is not None
        self.left, self.right, self.hidden = (np.flatnonzero(instance == i).astype(np.int32) for i in (0, 1, 4))
        self.ids = np.sort(np.concatenate([self.left, self.right, self.hidden]))
        self.grounder = Grounder(SceneContext(self.scene), self.ids, (self.left, self.right, self.hidden), CONFIG)

    def cut(self, rule: RegionRule, view: ShownView, **settings: object) -> list[int]:
        config = GroundingConfig.model_validate({"region": rule, **settings})
        (found,) = self.grounder.instances([view], config)
        return found.gaussians.tolist()


@pytest.fixture(scope="module")
def chairs() -> Chairs:
    return Chairs()


SHARED, ALONE = ShownView("both", BOTH, (0, 1)), ShownView("left", LEFT, (0,))


def test_frustum_holds_hidden_chairs_and_other_rules_leave_them_out(chairs: Chairs) -> None:
    assert set(chairs.hidden.tolist()) <= set(chairs.cut("frustum", SHARED))
    open_chairs = sorted([*chairs.left.tolist(), *chairs.right.tolist()])
    assert chairs.cut("cluster", SHARED) == open_chairs
    assert chairs.cut("depth", SHARED) == open_chairs
    assert not set(chairs.cut("visible", SHARED)) & set(chairs.hidden.tolist())


def test_visible_is_what_dominates_a_pixel_and_its_neighbours_by_brute_force(chairs: Chairs) -> None:
    near = MethodConfig.model_validate({"clustering": {"min_samples": 1}})
    grounder = Grounder(SceneContext(chairs.scene), chairs.ids, (chairs.left, chairs.right), near)
    (found,) = grounder.instances([SHARED], GroundingConfig(region="visible"))
    dominant = render(chairs.scene.gaussians, BOTH, ("dominant",)).dominant
    means = chairs.scene.gaussians.means.astype(np.float64)
    seeds = np.intersect1d(chairs.ids, dominant)
    apart = np.linalg.norm(means[chairs.ids][:, None] - means[seeds][None], axis=2).min(axis=1)
    reach = JOIN_EPSILONS * derived_epsilon(means[chairs.ids], 1)
    assert found.gaussians.tolist() == chairs.ids[apart <= reach].tolist()
    assert len(seeds) < len(found.gaussians) < len(chairs.left) + len(chairs.right)


@pytest.mark.parametrize("tolerance", [0.0, 0.2, 1.0])
def test_depth_keeps_centres_no_farther_than_what_their_pixel_shows(chairs: Chairs, tolerance: float) -> None:
    depth = render(chairs.scene.gaussians, BOTH, ("depth",)).depth
    assert depth is not None
    expected = []
    for j in frustum_region(BOTH, chairs.ids, chairs.scene.gaussians.means, GroundingConfig()).tolist():
        (pixel,), (z,) = BOTH.project(chairs.scene.gaussians.means[[j]])
        surface = depth[int(pixel[1]), int(pixel[0])]
        if surface == 0 or z <= surface + tolerance:
            expected.append(j)
    assert chairs.cut("depth", SHARED, depth_tolerance_m=tolerance) == expected


def test_cluster_in_frustum_is_where_the_two_rules_agree(chairs: Chairs) -> None:
    narrow = ShownView("narrow", camera_at((-1.5, -0.5, 1.0), (-3.0, 2, 0.9)), (0,))
    both = set(chairs.cut("frustum", narrow)) & set(chairs.cut("cluster", narrow))
    assert chairs.cut("cluster_in_frustum", narrow) == sorted(both)
    assert 0 < len(both) < len(chairs.left)


def test_prominent_is_the_cluster_with_most_pixels_whoever_the_view_was_chosen_for(chairs: Chairs) -> None:
    assert chairs.cut("prominent", ShownView("left", LEFT, (1,))) == chairs.left.tolist()


def test_instance_is_one_of_the_views_own_clusters_and_the_whole_of_it(chairs: Chairs) -> None:
    assert chairs.cut("instance", ALONE) == chairs.left.tolist()
    assert chairs.cut("instance", SHARED) in (chairs.left.tolist(), chairs.right.tolist())


def test_instance_that_the_view_does_not_show_is_the_cluster_as_it_is(chairs: Chairs) -> None:
    assert chairs.cut("instance", ShownView("left", LEFT, (2,))) == chairs.hidden.tolist()


def test_instance_drops_a_part_not_shown_and_takes_in_what_is_linked_to_the_rest(chairs: Chairs) -> None:
    half = chairs.left[: len(chairs.left) // 2]
    stuck = np.sort(np.concatenate([half, chairs.hidden]))
    grounder = Grounder(SceneContext(chairs.scene), chairs.ids, (stuck,), CONFIG)
    (found,) = grounder.instances([ALONE], GroundingConfig(region="instance"))
    assert found.gaussians.tolist() == chairs.left.tolist()


@pytest.mark.parametrize("rule", sorted(OF_CLUSTERS))
def test_instances_by_cluster_tell_the_chairs_of_one_view_apart(chairs: Chairs, rule: RegionRule) -> None:
    config = GroundingConfig(region=rule, instances="clusters")
    found = chairs.grounder.instances([SHARED], config)
    assert [(part.view, part.gaussians.tolist()) for part in found] == [
        ("both", chairs.left.tolist()),
        ("both", chairs.right.tolist()),
    ]


def test_no_view_said_to_show_a_target_is_no_instance(chairs: Chairs) -> None:
    assert chairs.grounder.instances([], GroundingConfig()) == ()


@pytest.mark.parametrize("rule", ["frustum", "visible", "depth", "prominent"])
def test_instances_by_cluster_need_a_rule_that_tells_them_apart(rule: RegionRule) -> None:
    with pytest.raises(ValidationError, match=f"{rule} does not tell the clusters"):
        GroundingConfig(region=rule, instances="clusters")


def test_standing_for_prefers_the_final_view_and_falls_back_to_the_initial_one() -> None:
    candidates = [["a", "a/0/left"], ["a", "a/1/left"], ["b", "b/2/left"]]
    assert standing_for(candidates, [0, 0, 0], ["a", "b"]) == {"a": (0, 1), "b": (2,)}
    assert standing_for(candidates, [1, 0, None], ["a/0/left", "a", "b"]) == {"a/0/left": (0,), "a": (1,), "b": (2,)}
    assert standing_for(candidates, [1, 1, 1], ["a", "b"]) == {"a": (0, 1), "b": (2,)}


def test_a_view_that_is_no_clusters_stands_for_all_that_considered_it() -> None:
    assert standing_for([["a", "x"], ["b", "x"]], [0, 0], ["a", "x"]) == {"a": (0,), "x": (0, 1)}


@given(st.lists(st.lists(st.integers(0, 5), min_size=1, max_size=4, unique=True), max_size=6), st.data())
def test_no_cluster_stands_in_two_views_that_are_some_clusters_own(
    candidates: list[list[int]], data: st.DataObject
) -> None:
    chosen = [data.draw(st.integers(0, len(views) - 1)) for views in candidates]
    shown = list(dict.fromkeys(views[choice] for views, choice in zip(candidates, chosen, strict=True)))
    owned = [number for numbers in standing_for(candidates, chosen, shown).values() for number in numbers]
    assert sorted(owned) == list(range(len(candidates)))


@pytest.fixture(scope="module")
def context() -> SceneContext:
    return SceneContext(tiny_scene())


def _rows(context: SceneContext, task: Task, **grounding: object) -> QuestionRows:
    question = Question("q1", "tiny", task, "the chairs", category="k", target_ids=(0, 1))
    config = MethodConfig.model_validate({"grounding": grounding, "evidence": {"k_eqa": 1}})
    return asyncio.run(answer_question(context, question, caller_of(Scripted({"evidence": "chair"})), config))


@pytest.mark.parametrize("task", ["ground_one", "ground_many"])
def test_every_grounding_row_says_its_rule_and_models_are_asked_the_same(context: SceneContext, task: Task) -> None:
    paper = _rows(context, task)
    assert {arm.region for arm in paper.arms} == {row.rule for row in paper.regions} == {"frustum"}
    for rule in sorted(LOOKING | OF_CLUSTERS):
        rows = _rows(context, task, region=rule)
        assert {arm.region for arm in rows.arms} == {row.rule for row in rows.regions} == {rule}
        assert rows.answers == paper.answers
        assert [arm.chosen for arm in rows.arms] == [arm.chosen for arm in paper.arms]


def test_rows_of_other_tasks_have_no_rule(context: SceneContext) -> None:
    assert {arm.region for arm in _rows(context, "eqa", region="cluster").arms} == {""}


def test_regions_by_cluster_are_the_chairs_themselves(context: SceneContext) -> None:
    instance = context.scene.semantics.instance
    assert instance is not None
    chairs = [tuple(np.flatnonzero(instance == number).tolist()) for number in (0, 1)]
    rows = _rows(context, "ground_many", region="cluster", instances="clusters")
    for arm in rows.arms:
        regions = [row.gaussians for row in rows.regions if row.arm == arm.arm]
        assert arm.predicted == len(regions)
        assert set(chairs) <= set(regions)
