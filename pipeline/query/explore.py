"""Views that no camera took: a search of free space for the poses that show a cluster best (policy `explore`).

Beyond the paper, whose moves of fixed length are its stated limit. Poses are proposed by geometry alone, looked at
in small dominance renders, and the best are moved a little while that helps. The first view returned is the best by
itself, each further one adds most to those before it. No randomness: the same scene and cluster give the same views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int32

from pipeline.geometry import Camera, look_at
from pipeline.query.explore_config import ExploreConfig, ExploreWeights
from pipeline.query.explore_objective import Sight, Target, look, make_target, score
from pipeline.query.explore_space import FreeSpace, map_space
from pipeline.query.visibility import fitted_to
from pipeline.render import PreparedGaussians, render_many
from pipeline.scene.scene import Scene

SPACING_M = 0.3
"""Distance of proposed places from one another: less would look at the same again."""
MOST_PLACES = 800
"""Places whose lines of sight are walked, at most, the ones nearest to the framing distance."""
SIGHT_POINTS = 32
"""Patches of the cluster to which lines of sight are walked."""
STEEPEST_SINE = 0.95
"""Sine of the steepest look up or down: nobody stands on what they look at."""
LEAST_DISTANCE_M = 1e-3
"""Nearer than this to where it looks, a camera has no direction: the middle of four walls is a free place."""
FRAMED_SHARE = 0.4
"""Share of the image's shorter side that a cluster's diameter should take."""
BLIND_SHARE = 0.05
"""Share of the cluster that a place is taken to see at least: cells are coarse, and a gap in a shelf is not."""
CROWDED_M = 0.6
"""A place this near to one already proposed counts half, as does a point of the cluster that one sees."""
DISTINCT_M = 0.4
"""Least distance between the views of a cluster: nearer ones are one view to a model."""
FIRST_STEP_M = 0.3
"""Length of the first steps from the best poses; later ones are half as long."""


@dataclass(frozen=True, slots=True)
class _Pose:
    """A pose that was looked at."""

    eye: Float64[np.ndarray, "3"]
    camera: Camera
    sight: Sight


class Explorer:
    """Searches one scene. The map of its free space is made at the first search.

    Args:
        scene: Gaussians, recorded views and up.
        gaussians: The Gaussians, prepared.
        times_seen: How many recorded views saw the cell of each Gaussian, from `view_quality.times_seen`.
        config: Where to look, what to look for, and at what cost.
        near_m: Near plane of the renders, metres.
        threads: Renders side by side.
    """

    def __init__(
        self,
        scene: Scene,
        gaussians: PreparedGaussians,
        times_seen: Int32[np.ndarray, "M"],
        config: ExploreConfig,
        *,
        near_m: float = 0.2,
        threads: int = 1,
    ) -> None:
        self._scene, self._gaussians, self._times_seen = scene, gaussians, times_seen
        self._config, self._near_m, self._threads = config, near_m, threads
        self._found: dict[tuple[bytes | int, ...], tuple[Camera, ...]] = {}
        self.renders = 0
        """Coarse renders so far."""

    @cached_property
    def space(self) -> FreeSpace:
        """Where a camera may stand."""
        centers = np.stack([view.camera.center for view in self._scene.views])
        return map_space(self._scene.gaussians, centers, self._scene.up, self._config)

    @property
    def prepared(self) -> bool:
        """Whether the map of free space is there."""
        return "_places" in vars(self)

    def prepare(self) -> None:
        """Make the map of free space, should it not be there yet."""
        self._places  # noqa: B018

    def explore(self, cluster: Int32[np.ndarray, "n"], lens: Camera, count: int) -> tuple[Camera, ...]:
        """Return up to `count` cameras that show a cluster, best first; fewer where free space offers no more.

        Args:
            cluster: Distinct indices of its Gaussians, at least one.
            lens: Lens and image size of the views; its pose does not count.
            count: V.
        """
        key = (cluster.tobytes(), lens.K.tobytes(), lens.width, lens.height, count)
        if key not in self._found:
            self._found[key] = self._search(cluster, lens, count)
        return self._found[key]

    def _search(self, cluster: Int32[np.ndarray, "n"], lens: Camera, count: int) -> tuple[Camera, ...]:
        config = self._config
        target = make_target(self._scene.gaussians.means, cluster, config.surroundings_m)
        left = config.renders
        pool = self._look(self._proposed(target, lens, left - int(config.refine * left)), target, lens)
        left -= len(pool)
        step = FIRST_STEP_M
        while left > 0 and pool:
            best = _chosen(pool, target, count, config.weights)
            around = self._steps(best, target, step)[:left]
            if around:
                pool += self._look(around, target, lens)
            left -= max(1, len(around))
            step /= 2
        return tuple(pose.camera for pose in _chosen(pool, target, count, config.weights))

    def _look(
        self, poses: Sequence[tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]], target: Target, lens: Camera
    ) -> list[_Pose]:
        """Render poses, pairs of eye and aim, and return what each shows."""
        cameras = [lens.moved_to(look_at(eye, aim, self._scene.up)) for eye, aim in poses]
        small = [fitted_to(camera, self._config.long_side) for camera in cameras]
        self.renders += len(small)
        images = render_many(self._gaussians, small, ("dominant",), near=self._near_m, threads=self._threads)
        found = []
        for (eye, _), camera, shrunk, image in zip(poses, cameras, small, images, strict=True):
            assert image.dominant is not None
            sight = look(image.dominant, shrunk, target, self._scene.gaussians.means, self._times_seen)
            found.append(_Pose(eye, camera, sight))
        return found

    def _proposed(
        self, target: Target, lens: Camera, count: int
    ) -> list[tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]]:
        """Return poses by geometry alone: from places that see the cluster at a good distance, on all sides of it."""
        aim = target.middle
        eyes = self._places
        offset = eyes - aim
        distance = np.linalg.norm(offset, axis=1)
        fitting = self._framing_distance(target, lens)
        fair = (distance > LEAST_DISTANCE_M) & (distance <= self._config.farthest_m)
        fair &= np.abs(offset @ self._scene.up) <= STEEPEST_SINE * distance
        eyes, distance = eyes[fair], distance[fair]
        off = np.abs(np.log(distance / fitting))
        nearest = np.argsort(off, kind="stable")[:MOST_PLACES]
        eyes, off = eyes[nearest], off[nearest]
        points = target.points[:: max(1, len(target.points) // SIGHT_POINTS)]
        seen = self.space.sees(eyes, points).astype(np.float64)
        worth = np.exp(-0.5 * off**2)
        wanted = np.ones(len(points))
        chosen: list[tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]] = []
        for _ in range(min(count, len(eyes))):
            best = int(((seen @ wanted / len(points) + BLIND_SHARE) * worth).argmax())
            chosen.append((eyes[best], aim))
            wanted[seen[best] > 0] *= 0.5
            worth[np.linalg.norm(eyes - eyes[best], axis=1) < CROWDED_M] *= 0.5
            worth[best] = 0.0
        return chosen

    def _steps(
        self, best: Sequence[_Pose], target: Target, step: float
    ) -> list[tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]]:
        """Return the free places a step away from the best poses, aimed at what is seen of the cluster from there."""
        up, poses = self._scene.up, []
        for pose in best:
            shown = target.points[pose.sight.seen[: target.patches]]
            aim = shown.mean(axis=0) if len(shown) else target.middle
            right = pose.camera.world_to_camera[0, :3]
            level = np.cross(up, right)
            moves = [step * axis for axis in (level, -level, right, -right, up, -up)]
            eyes = pose.eye + np.array([np.zeros(3), *moves])
            apart = np.linalg.norm(eyes - aim, axis=1) > LEAST_DISTANCE_M
            poses.append([(eye, aim) for eye in eyes[apart & self.space.allows(eyes)]])
        most = max((len(own) for own in poses), default=0)
        return [own[number] for number in range(most) for own in poses if number < len(own)]

    @cached_property
    def _places(self) -> Float64[np.ndarray, "n 3"]:
        """Stands about `SPACING_M` apart: the first in each cell of that size, recorded centres before others."""
        stands = self.space.stands
        cells = np.floor(stands / SPACING_M).astype(np.int64)
        return stands[np.sort(np.unique(cells, axis=0, return_index=True)[1])]

    def _framing_distance(self, target: Target, lens: Camera) -> float:
        """Distance at which the cluster's diameter takes the wanted share of the image's shorter side, metres."""
        side = min(lens.width / lens.K[0, 0], lens.height / lens.K[1, 1])
        return float(np.clip(2 * target.radius_m / (FRAMED_SHARE * side), 0.5, self._config.farthest_m))


def _chosen(pool: Sequence[_Pose], target: Target, count: int, weights: ExploreWeights) -> list[_Pose]:
    """Return the poses that add most, one after the other."""
    covered = np.zeros(target.patches + target.around, bool)
    left = list(pool)
    chosen: list[_Pose] = []
    while left and len(chosen) < count:
        scores = [score(pose.sight, target, covered, weights) for pose in left]
        best = left[int(np.argmax(scores))]
        covered = covered | best.sight.seen
        chosen.append(best)
        left = [pose for pose in left if np.linalg.norm(pose.eye - best.eye) >= DISTINCT_M]
    return chosen
