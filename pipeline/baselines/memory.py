"""3D-Mem: memory snapshots of a scene, of which those that hold an evidence category are shown with the question."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePosixPath

import numpy as np

from pipeline.baselines.boxes import level_axes
from pipeline.baselines.config import MemorySnapshotsConfig
from pipeline.baselines.frames import answer_frames, shown_views
from pipeline.baselines.material import Material
from pipeline.baselines.once import once
from pipeline.baselines.scene_objects import objects_index, scene_objects
from pipeline.baselines.snapshot_rule import choose_snapshots
from pipeline.baselines.steps import BaselineSteps
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import Stopwatch
from pipeline.query.visibility import VisibilityConfig
from pipeline.tasks.context import SceneContext
from schemas import storage
from schemas.errors import InputError
from schemas.questions import Question

Memory = Mapping[int, tuple[str, ...]]
"""Categories of the objects that a view stands for, by the view's number."""


def build_memory(context: SceneContext, config: MemorySnapshotsConfig, watch: Stopwatch) -> Memory:
    """Return the snapshots of a scene by 3D-Mem's rule.

    A detector's part is played by the visibility index: a view holds an object of which it sees enough from near by,
    and is as sure of it as the share it sees.

    Args:
        context: The scene's caches.
        config: The baseline's.
        watch: Where seconds are kept.
    """
    found = scene_objects(context, config.objects, watch, every_view=True)
    if not found:
        return {}
    with watch.stage("snapshots", len(found)):
        scores = context.index(config.objects.visibility).counts([one.ids for one in found]).scores
        centres = np.array([one.centre for one in found])
        eyes = np.array([view.camera.center for view in context.scene.views])
        near = np.linalg.norm(centres[:, None] - eyes[None], axis=2) <= config.max_distance_m
        held = near & (scores > 0) & (scores >= config.min_visibility)
        places = centres @ level_axes(context.scene)[:2].T
        snapshots = choose_snapshots(places, held, scores)
    return {one.frame: tuple(sorted({found[number].category for number in one.objects})) for one in snapshots}


def read_memory(uri: str, context: SceneContext) -> Memory:
    """Return the snapshots in a JSON file: by view name, or image file of that name, the categories of its objects.

    Raises:
        InputError: The file is missing, is no such JSON, or names a view that the scene lacks.
    """
    try:
        data = json.loads(storage.read_bytes(uri))
    except ValueError as error:
        raise InputError(uri, expected="JSON: {view name: [category, ...]}", found=str(error)) from error
    if not isinstance(data, dict):
        raise InputError(uri, expected="JSON: {view name: [category, ...]}", found=type(data).__name__)
    numbers = {view.name: number for number, view in enumerate(context.scene.views)}
    memory: dict[int, tuple[str, ...]] = {}
    for name, categories in data.items():
        number = numbers.get(name, numbers.get(PurePosixPath(name).stem))
        if number is None:
            raise InputError(uri, field=name, expected=f"a view of {context.scene.name}", found="none of that name")
        if not isinstance(categories, list) or not all(isinstance(one, str) for one in categories):
            raise InputError(uri, field=name, expected="a list of category names", found=repr(categories)[:80])
        memory[number] = tuple(categories)
    return dict(sorted(memory.items()))


def _gather(
    context: SceneContext, question: Question, evidence: Evidence, config: MemorySnapshotsConfig, watch: Stopwatch
) -> Material:
    memory = once(context, config, lambda: _memory(context, config, watch))
    wanted = set(evidence.categories)
    views = [view for view, categories in memory.items() if wanted & set(categories)]
    if not views:
        reason = f"no snapshot holds {', '.join(evidence.categories)}"
        return Material("skipped", reason, objects=len(memory))
    return replace(shown_views(context, views, config, watch), objects=len(memory))


def _memory(context: SceneContext, config: MemorySnapshotsConfig, watch: Stopwatch) -> Memory:
    if config.file is None:
        return build_memory(context, config, watch)
    return read_memory(config.file.replace("{scene}", context.scene.name), context)


def _index(config: MemorySnapshotsConfig) -> VisibilityConfig | None:
    return objects_index(config) if config.file is None else None


MEMORY_SNAPSHOTS = BaselineSteps(
    "memory_snapshots", "eqa", _gather, answer_frames, shows=True, asks_evidence=True, reads_index=_index
)
"""3D-Mem."""
