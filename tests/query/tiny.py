"""A small hand-made scene and a scripted model, shared by the tests of the query stages and of the tasks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, get_args

import numpy as np

from pipeline.geometry import Camera, look_at
from pipeline.models.caller import Caller
from pipeline.models.messages import Reply, Request, Stage
from pipeline.models.prompts import Prompts
from pipeline.scene.gaussians import Gaussians
from pipeline.scene.scene import Scene
from pipeline.scene.semantics import Semantics
from pipeline.scene.views import View

UP = np.array([0.0, 0.0, 1.0])
VOCABULARY = ("chair", "table", "wall", "zebra")
STAGES = get_args(Stage)


def gaussians_at(means: np.ndarray, scale_m: float = 0.06, opacity_logit: float = 3.0, seed: int = 0) -> Gaussians:
    """Round Gaussians of one size at given centres, with random colours."""
    count = len(means)
    rng = np.random.default_rng(seed)
    return Gaussians(
        means=np.asarray(means, np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.full((count, 3), np.log(scale_m), np.float32),
        opacity_logits=np.full(count, opacity_logit, np.float32),
        sh=rng.normal(0, 0.5, (count, 1, 3)).astype(np.float32),
    )


def box_points(center: Sequence[float], half: Sequence[float], step: float = 0.1) -> np.ndarray:
    """A regular grid of points that fills a box."""
    axes = [np.arange(c - h, c + h + 1e-9, step) for c, h in zip(center, half, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def camera_at(eye: Sequence[float], target: Sequence[float], width: int = 48, height: int = 36) -> Camera:
    """A level camera with a 62 degree lens."""
    K = np.array([[0.84 * width, 0, width / 2], [0, 0.84 * width, height / 2], [0, 0, 1.0]])
    return Camera(K, look_at(np.array(eye, float), np.array(target, float), UP), width, height)


def tiny_scene(name: str = "tiny") -> Scene:
    """Two chairs and a table in the open, a chair that a wall hides from every view, and six views.

    Instances: 0 and 1 the chairs in the open, 2 the table, 3 the wall, 4 the hidden chair.
    """
    parts = [
        ("chair", box_points((-1.5, 2.0, 0.4), (0.2, 0.2, 0.4))),
        ("chair", box_points((1.5, 2.0, 0.4), (0.2, 0.2, 0.4))),
        ("table", box_points((0.0, 3.0, 0.35), (0.4, 0.3, 0.35))),
        ("wall", box_points((0.0, 5.0, 1.0), (3.0, 0.1, 1.0), 0.12)),
        ("chair", box_points((0.0, 7.0, 0.4), (0.2, 0.2, 0.4))),
    ]
    order = [0, 1, 2, 3, 4]
    category = np.concatenate([np.full(len(parts[i][1]), VOCABULARY.index(parts[i][0])) for i in order])
    instance = np.concatenate([np.full(len(parts[i][1]), i) for i in order])
    means = np.concatenate([parts[i][1] for i in order])
    targets = [(-1.5, 2, 0.4), (1.5, 2, 0.4), (0, 3, 0.4), (0, 3, 0.4), (-1.0, 3, 0.4), (0, 3, 0.6)]
    eyes = [(-1.5, -0.5, 1.0), (1.5, -0.5, 1.0), (0, 0, 1.2), (-0.4, -1.5, 1.4), (2.5, 0.2, 1.0), (0, -3, 1.5)]
    views = tuple(
        View(f"view{i}", camera_at(eye, target)) for i, (eye, target) in enumerate(zip(eyes, targets, strict=True))
    )
    semantics = Semantics(VOCABULARY, category.astype(np.int32), instance=instance.astype(np.int32))
    return Scene(name, gaussians_at(means), views, semantics, UP)


def without_instances(scene: Scene) -> Scene:
    """The same scene with nothing known of ground-truth instances."""
    return dataclasses.replace(scene, semantics=dataclasses.replace(scene.semantics, instance=None))


class Scripted:
    """A chat client that answers by stage from given functions and keeps every request."""

    def __init__(self, replies: Mapping[str, Callable[[Request], str] | str]) -> None:
        self.replies = {**DEFAULT_REPLIES, **replies}
        self.requests: list[Request] = []

    @property
    def name(self) -> str:
        return "scripted:script"

    def identity(self) -> Mapping[str, Any]:
        return {"model": "script"}

    async def complete(self, request: Request) -> Reply:
        self.requests.append(request)
        reply = self.replies[request.stage]
        return Reply(reply if isinstance(reply, str) else reply(request), 3, 1, "script")

    def count(self, stage: str) -> int:
        """Return how many requests a stage sent."""
        return sum(request.stage == stage for request in self.requests)


DEFAULT_REPLIES: Mapping[str, Callable[[Request], str] | str] = {
    "evidence": lambda request: "\n".join(request.variables["categories"][: request.variables["k"]]),
    "view_answer": lambda request: f"shade {int(request.images()[0].color.astype(int).sum())}",
    "choice": lambda request: str(len(request.variables["candidates"]) - 1),
    "verify": "1",
    "answer_one": lambda request: f"Image 0\nseen {sum(int(i.color.astype(int).sum()) for i in request.images())}",
    "answer_many": lambda request: "\n".join(f"Image {i}: Yes" for i in range(len(request.images()))),
    "judge": "Your mark: 4",
    "caption": "A chair stands beside a table.",
    "answer_text": "A chair.",
    "answer_blind": "A lamp.",
}


def caller_of(client: Scripted, **options: Any) -> Caller:
    """A caller that sends every stage to one client and stores nothing."""
    return Caller(dict.fromkeys(STAGES, client), Prompts.load(), None, **options)
