"""From evidence to candidate views: activation, clusters, initial views, novel poses and pictures. CPU only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int32

from pipeline.config import MethodConfig
from pipeline.geometry import Camera
from pipeline.models.messages import ImagePart
from pipeline.query.candidates import Picture, Source
from pipeline.query.evidence import Evidence
from pipeline.query.initial_views import by_visible_size
from pipeline.query.perturb import NovelPose, explored_pose, novel_poses
from pipeline.query.stopwatch import StageTime, Stopwatch
from pipeline.query.view_quality import ViewQuality, view_quality
from pipeline.tasks.context import FoundCluster, SceneContext
from schemas.answers import Status
from schemas.questions import Question


@dataclass(frozen=True, slots=True)
class Candidate:
    """One candidate view of a cluster."""

    id: str
    """The recorded view's name, or "<view>/<cluster>/<move>"."""
    move: str
    """initial, left, right, ..."""
    camera: Camera
    """Pose, with the recorded view's lens."""
    requested_m: float
    """Length of the move asked for, metres."""
    moved_m: float
    """Length of the move made, metres."""
    quality: ViewQuality
    """How well it shows the cluster, at the pictures' size."""
    source: Source
    """photo or render."""
    picture: int
    """Position in `Proposal.pictures`; equal pictures are held once."""


@dataclass(frozen=True, slots=True)
class Group:
    """A cluster and its candidate views (H_candi, paper 3.2)."""

    cluster: int
    """Number in this question, by visible size."""
    category: str
    """Category."""
    ids: Int32[np.ndarray, "n"]
    """Its Gaussians, sorted."""
    centre: tuple[float, float, float]
    """Mean of its centres, metres."""
    initial_view: str
    """Name of the recorded view; empty when none sees the cluster."""
    visibility: float
    """S_vis from there, at the size of the visibility renders."""
    visible: int
    """|G_vis| from there."""
    candidates: tuple[Candidate, ...]
    """The initial view first, then the novel ones; none for a cluster that no view sees."""

    @property
    def size(self) -> int:
        """|G_cluster|."""
        return len(self.ids)


@dataclass(frozen=True, slots=True)
class Proposal:
    """Everything the models are asked about for one question."""

    status: Status
    """answered when there is something to look at."""
    reason: str
    """Why there is not."""
    categories: tuple[str, ...]
    """Evidence categories."""
    activated: Int32[np.ndarray, "n"]
    """G_act, sorted."""
    groups: tuple[Group, ...]
    """The L clusters kept, by visible size, then those that no view sees."""
    clusters_found: int
    """Clusters before the cap."""
    pictures: tuple[ImagePart, ...]
    """Distinct pictures of all candidates."""
    times: tuple[StageTime, ...]
    """Seconds by stage."""

    @property
    def seen(self) -> tuple[Group, ...]:
        """The L clusters with candidate views."""
        return tuple(group for group in self.groups if group.candidates)

    def candidate_of(self, picture: int) -> Candidate:
        """Return the first candidate that shows a picture."""
        return next(c for group in self.groups for c in group.candidates if c.picture == picture)


def nothing_to_show(evidence: Evidence, status: Status, reason: str) -> Proposal:
    """Return the proposal of a question for which nothing is rendered."""
    return Proposal(status, reason, evidence.categories, np.empty(0, np.int32), (), 0, (), ())


def propose(context: SceneContext, question: Question, evidence: Evidence, config: MethodConfig) -> Proposal:
    """Return the clusters of the evidence categories and the views to judge for each.

    Nothing is rendered when there is no evidence. Clusters that choose the same view share its picture.

    Args:
        context: The scene's caches.
        question: The query.
        evidence: Categories to search for.
        config: The method's.

    Raises:
        InputError: The scene lacks what activation needs, or a photograph cannot be read.
    """
    if evidence.status != "answered":
        return nothing_to_show(evidence, evidence.status, evidence.reason)
    watch, categories = Stopwatch(), evidence.categories
    with watch.stage("activate", len(categories)):
        active = [context.activation(category, config.activation).ids for category in categories]
        activated = np.unique(np.concatenate(active)).astype(np.int32)
    with watch.stage("cluster", len(activated)):
        found = sum(len(context.clusters(category, config)) for category in categories)
    if context.builds_index(categories, config):
        index = context.index(config.visibility)
        with watch.stage("index", index.missing, whole_scene=True):
            index.build()
    with watch.stage("visibility", found):
        clusters = [cluster for category in categories for cluster in context.found_clusters(category, config)]
        order = by_visible_size(tuple(cluster.initial for cluster in clusters))
    ranked = [clusters[position] for position in order]
    kept = [c for c in ranked if c.initial.view is not None][: config.initial_views.max_clusters(question)]
    _prepare_search(context, watch, config)
    album = _Album()
    groups = [_group(context, number, cluster, album, watch, config) for number, cluster in enumerate(kept)]
    unseen = [cluster for cluster in ranked if cluster.initial.view is None]
    groups += [_unseen(number, cluster) for number, cluster in enumerate(unseen, start=len(kept))]
    status: Status = "answered" if kept else "skipped"
    reason = "" if kept else f"no recorded view sees any of {found} clusters of {', '.join(categories)}"
    return Proposal(status, reason, categories, activated, tuple(groups), found, album.images(), _merged(watch))


class _Album:
    """Distinct pictures of one question."""

    def __init__(self) -> None:
        self._positions: dict[tuple[object, ...], int] = {}
        self._pictures: list[Picture] = []

    def add(self, picture: Picture) -> int:
        """Return the position of a picture; one of equal key is held once."""
        if picture.key not in self._positions:
            self._positions[picture.key] = len(self._pictures)
            self._pictures.append(picture)
        return self._positions[picture.key]

    def images(self) -> tuple[ImagePart, ...]:
        return tuple(picture.image for picture in self._pictures)


def _group(
    context: SceneContext, number: int, cluster: FoundCluster, album: _Album, watch: Stopwatch, config: MethodConfig
) -> Group:
    view_number = cluster.initial.view
    assert view_number is not None
    view = context.scene.views[view_number]
    poses = _novel_poses(context, cluster, view_number, watch, config)
    with watch.stage("render", 1 + len(poses)):
        cameras = [view.camera, *(pose.camera for pose in poses)]
        pictures = context.pictures(config.images).render_all(cameras, [view, *(None for _ in poses)])
    with watch.stage("quality", len(pictures)):
        seen, means = context.times_seen(config), context.scene.gaussians.means
        qualities = [
            view_quality(picture.footprint, pictures[0].footprint, cluster.ids, means, camera, seen)
            for picture, camera in zip(pictures, cameras, strict=True)
        ]
    names = [view.name, *(f"{view.name}/{number}/{pose.move}" for pose in poses)]
    moves = [NovelPose("initial", view.camera, 0.0, 0.0), *poses]
    candidates = [
        Candidate(name, m.move, m.camera, m.requested_m, m.moved_m, quality, picture.source, album.add(picture))
        for name, m, quality, picture in zip(names, moves, qualities, pictures, strict=True)
    ]
    return Group(
        number,
        cluster.category,
        cluster.ids,
        _point(cluster),
        view.name,
        cluster.initial.visibility,
        cluster.initial.visible,
        tuple(candidates),
    )


def _prepare_search(context: SceneContext, watch: Stopwatch, config: MethodConfig) -> None:
    """Make what a search for views needs, once a scene, so that no question's time holds it."""
    if config.novel_views.policy == "explore" and config.novel_views.count:
        explorer = context.explorer(config)
        if not explorer.prepared:
            with watch.stage("space", len(context.scene.views), whole_scene=True):
                explorer.prepare()


def _novel_poses(
    context: SceneContext, cluster: FoundCluster, view_number: int, watch: Stopwatch, config: MethodConfig
) -> tuple[NovelPose, ...]:
    """Return the novel poses of a cluster, moved from its initial view or searched for."""
    novel, camera = config.novel_views, context.scene.views[view_number].camera
    if novel.policy == "explore" and novel.count:
        with watch.stage("explore", novel.count):
            found = context.explorer(config).explore(cluster.ids, camera, novel.count)
        return tuple(explored_pose(number, camera, pose) for number, pose in enumerate(found, start=1))
    with watch.stage("perturb", novel.count):
        free = context.free_distances(view_number, novel)
        return novel_poses(context.gaussians, camera, cluster.centre, context.scene.up, novel, free)


def _unseen(number: int, cluster: FoundCluster) -> Group:
    return Group(number, cluster.category, cluster.ids, _point(cluster), "", 0.0, 0, ())


def _point(cluster: FoundCluster) -> tuple[float, float, float]:
    x, y, z = cluster.centre.tolist()
    return x, y, z


def _merged(watch: Stopwatch) -> tuple[StageTime, ...]:
    """One entry a stage, in the order of first appearance."""
    merged: dict[tuple[str, bool], StageTime] = {}
    for time in watch.times():
        key = (time.stage, time.whole_scene)
        old = merged.get(key, StageTime(time.stage, 0.0, 0, time.whole_scene))
        merged[key] = StageTime(time.stage, old.seconds + time.seconds, old.count + time.count, time.whole_scene)
    return tuple(merged.values())
