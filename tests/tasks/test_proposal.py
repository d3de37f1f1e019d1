from __future__ import annotations

import numpy as np
import pytest

from pipeline.config import MethodConfig
from pipeline.query.evidence import Evidence
from pipeline.tasks.context import SceneContext, scene_vocabulary
from pipeline.tasks.proposal import Proposal, propose
from schemas.errors import InputError
from schemas.questions import Question, Task
from tests.query.tiny import tiny_scene


@pytest.fixture(scope="module")
def context() -> SceneContext:
    return SceneContext(tiny_scene())


def _evidence(*categories: str) -> Evidence:
    return Evidence("answered", "", categories, (), 0.0)


def _propose(context: SceneContext, *categories: str, task: Task = "eqa", **options: object) -> Proposal:
    config = MethodConfig.model_validate(options)
    return propose(context, Question("q", "tiny", task, "what?"), _evidence(*categories), config)


def test_vocabulary_is_the_sorted_names_present(context: SceneContext) -> None:
    assert context.vocabulary == scene_vocabulary(context.scene) == ("chair", "table", "wall")


def test_each_cluster_gets_its_initial_view_and_four_novel_ones(context: SceneContext) -> None:
    proposal = _propose(context, "chair", "table")
    assert [group.category for group in proposal.seen] == ["table", "chair", "chair"]
    for number, group in enumerate(proposal.seen):
        assert group.cluster == number
        assert [c.move for c in group.candidates] == ["initial", "left", "right", "forward", "backward"]
        assert group.candidates[0].id == group.initial_view
        assert [c.id for c in group.candidates[1:]] == [
            f"{group.initial_view}/{number}/{move}" for move in ("left", "right", "forward", "backward")
        ]
        assert all(c.requested_m == 0.3 for c in group.candidates[1:])
        assert group.candidates[0].quality.visibility == group.visibility == group.visible / group.size


def test_clusters_are_numbered_by_visible_size(context: SceneContext) -> None:
    visible = [group.visible for group in _propose(context, "chair", "table", "wall").groups]
    assert visible == sorted(visible, reverse=True)


def test_cluster_that_no_view_sees_is_listed_last_without_candidates(context: SceneContext) -> None:
    proposal = _propose(context, "chair")
    hidden = proposal.groups[-1]
    assert (hidden.initial_view, hidden.visible, hidden.candidates) == ("", 0, ())
    assert hidden.centre == pytest.approx((0, 7, 0.4), abs=1e-5)
    assert len(proposal.seen) == 2
    assert proposal.clusters_found == 3


def test_cap_keeps_the_most_visible_and_counts_all(context: SceneContext) -> None:
    proposal = _propose(context, "chair", "table", initial_views={"max_clusters_eqa": 1})
    assert [group.category for group in proposal.seen] == ["table"]
    assert proposal.clusters_found == 4
    assert len(_propose(context, "chair", "table", task="ground_many").seen) == 3


def test_activated_is_the_sorted_union_of_all_categories(context: SceneContext) -> None:
    category = context.scene.semantics.category
    expected = np.flatnonzero(np.isin(category, [0, 1]))
    np.testing.assert_array_equal(_propose(context, "table", "chair").activated, expected)


def test_clusters_with_one_initial_view_share_its_picture(context: SceneContext) -> None:
    proposal = _propose(context, "chair", "table", "wall", visibility={"near_m": 0.2})
    by_view: dict[str, set[int]] = {}
    for group in proposal.seen:
        by_view.setdefault(group.initial_view, set()).add(group.candidates[0].picture)
    assert all(len(pictures) == 1 for pictures in by_view.values())


def test_equal_pictures_are_held_once_whatever_the_cache_keeps() -> None:
    scene = tiny_scene()
    one_view = SceneContext(type(scene)(scene.name, scene.gaussians, scene.views[5:], scene.semantics, scene.up))
    for cache_mb in (0, 512):
        proposal = _propose(one_view, "chair", "table", "wall", images={"cache_mb": cache_mb})
        groups = proposal.seen
        assert len(groups) == 4
        assert len({group.candidates[0].picture for group in groups}) == 1
        forward = [next(c for c in group.candidates if c.move == "forward") for group in groups]
        assert len({candidate.picture for candidate in forward}) == 1, "forward does not turn toward the cluster"
        assert len({candidate.id for candidate in forward}) == 4
        assert len(proposal.pictures) == 3 + 2 * 4


def test_every_candidate_is_measured_against_its_initial_view(context: SceneContext) -> None:
    context.index(MethodConfig().visibility).build()
    for group in _propose(context, "chair", "table").seen:
        first, *others = [candidate.quality for candidate in group.candidates]
        assert first.new_gaussians == 0
        assert any(other.new_gaussians > 0 for other in others)
        for quality in (first, *others):
            assert 0 < quality.area < 1
            assert 0 <= quality.centring <= 1
            assert quality.unobserved is not None
            assert 0 <= quality.unobserved <= 1


def test_what_was_observed_is_unknown_with_a_lazy_index() -> None:
    proposal = _propose(SceneContext(tiny_scene()), "chair", visibility={"build": "lazy"})
    qualities = [candidate.quality for group in proposal.seen for candidate in group.candidates]
    assert {(quality.unobserved, quality.floaters) for quality in qualities} == {(None, None)}


EXPLORE = {"novel_views": {"policy": "explore", "count": 3, "explore": {"long_side": 48}}}


@pytest.fixture(scope="module")
def explored() -> Proposal:
    return _propose(SceneContext(tiny_scene()), "chair", "table", **EXPLORE)


class TestExplore:
    """Policy `explore`."""

    def test_candidates_are_the_initial_view_and_those_found(self, explored: Proposal) -> None:
        for group in explored.seen:
            assert [c.move for c in group.candidates] == ["initial", "explore_1", "explore_2", "explore_3"]
            initial = group.candidates[0].camera.center
            for candidate in group.candidates[1:]:
                away = np.linalg.norm(candidate.camera.center - initial)
                assert candidate.requested_m == candidate.moved_m == pytest.approx(away)
                assert candidate.quality.unobserved is not None, "a search has the whole index rendered"

    def test_some_view_found_shows_more_than_the_recorded_one(self, explored: Proposal) -> None:
        for group in explored.seen:
            assert max(c.quality.visibility for c in group.candidates[1:]) > group.visibility

    def test_another_question_about_the_category_searches_no_more(self) -> None:
        context, config = SceneContext(tiny_scene()), MethodConfig.model_validate(EXPLORE)
        first = _propose(context, "chair", **EXPLORE)
        renders = context.explorer(config).renders
        again = _propose(context, "chair", **EXPLORE)
        assert context.explorer(config).renders == renders > 0
        assert [i.sha256() for i in again.pictures] == [i.sha256() for i in first.pictures]
        stages = [[time.stage for time in proposal.times] for proposal in (first, again)]
        assert ["space" in names for names in stages] == [True, False], "the map of free space is made once"

    def test_two_threads_change_nothing(self, explored: Proposal) -> None:
        other = _propose(SceneContext(tiny_scene(), threads=2), "chair", "table", **EXPLORE)
        assert [i.sha256() for i in other.pictures] == [i.sha256() for i in explored.pictures]
        measured = [[[c.quality for c in group.candidates] for group in p.seen] for p in (other, explored)]
        assert measured[0] == measured[1]

    def test_no_novel_view_needs_no_search(self) -> None:
        settings = {"novel_views": {"policy": "explore", "count": 0}}
        proposal = _propose(SceneContext(tiny_scene()), "chair", **settings)
        assert [len(group.candidates) for group in proposal.seen] == [1, 1]
        assert "space" not in [time.stage for time in proposal.times]


def test_no_novel_view_leaves_the_initial_one(context: SceneContext) -> None:
    proposal = _propose(context, "chair", novel_views={"count": 0})
    assert all(len(group.candidates) == 1 for group in proposal.seen)


@pytest.mark.parametrize("status", ["skipped", "unparsed", "failed"])
def test_without_evidence_nothing_is_rendered(status: str) -> None:
    context = SceneContext(tiny_scene())
    evidence = Evidence(status, "a reason", (), (), 0.0)
    proposal = propose(context, Question("q", "tiny", "eqa", "what?"), evidence, MethodConfig())
    assert (proposal.status, proposal.reason, proposal.pictures) == (status, "a reason", ())
    assert "gaussians" not in vars(context), "not even prepared"


def test_evidence_that_no_view_sees_is_skipped_with_a_reason() -> None:
    scene = tiny_scene()
    behind = np.flatnonzero(scene.semantics.instance >= 3)
    semantics = type(scene.semantics)(scene.semantics.vocabulary, scene.semantics.category[behind])
    context = SceneContext(type(scene)("behind", scene.gaussians.take(behind), scene.views, semantics, scene.up))
    proposal = _propose(context, "chair")
    assert proposal.status == "skipped"
    assert "no recorded view sees any of 1 clusters of chair" in proposal.reason
    assert len(proposal.groups) == 1
    assert proposal.pictures == ()


def test_unknown_category_is_an_input_error(context: SceneContext) -> None:
    with pytest.raises(InputError, match="sofa"):
        _propose(context, "sofa")


def test_second_question_on_a_category_renders_nothing_more() -> None:
    context = SceneContext(tiny_scene())
    first = _propose(context, "chair")
    renders = context.pictures(MethodConfig().images).renders
    again = _propose(context, "chair")
    assert context.pictures(MethodConfig().images).renders == renders == len(first.pictures)
    assert [image.sha256() for image in again.pictures] == [image.sha256() for image in first.pictures]
    stages = [(time.stage, time.whole_scene) for time in first.times]
    assert ("index", True) in stages
    assert ("index", True) not in [(time.stage, time.whole_scene) for time in again.times]


def test_stages_are_timed_once_each_with_their_counts(context: SceneContext) -> None:
    times = {time.stage: time for time in _propose(context, "chair").times}
    assert set(times) - {"index"} == {"activate", "cluster", "visibility", "perturb", "render", "quality"}
    assert times["activate"].count == 1
    assert times["perturb"].count == 8
    assert times["render"].count == 10
    assert all(time.seconds >= 0 for time in times.values())
