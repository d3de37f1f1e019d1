"""Objects read off a sparse voxel map of the scene's labels, in text: no view is rendered and no picture described."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, Int32

from pipeline.baselines.boxes import object_box, place_notes
from pipeline.baselines.captions import answer_notes
from pipeline.baselines.config import VoxelCaptionsConfig
from pipeline.baselines.material import Material
from pipeline.baselines.once import once
from pipeline.baselines.steps import BaselineSteps
from pipeline.models.caller import Caller
from pipeline.query.activate import ids_with_label
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import Stopwatch
from pipeline.scene.color_names import dominant_color
from pipeline.tasks.context import SceneContext
from pipeline.tasks.task_answer import TaskAnswer
from schemas.calls import CallRow
from schemas.questions import Question

SH_C0 = 0.28209479177387814
"""Value of the constant spherical harmonic: a Gaussian's mean colour is 0.5 + SH_C0 times its first coefficient."""
TOUCHING = 1.8
"""Distance in voxels within which two touch by a face, an edge or a corner: sqrt(3) and a little."""


def voxel_objects(means: Float[np.ndarray, "n 3"], voxel_m: float, min_voxels: int) -> list[Int[np.ndarray, "_"]]:
    """Return the Gaussians of each group of touching voxels, the largest group first.

    Args:
        means: Centres of the Gaussians of one label, metres.
        voxel_m: Side of a voxel.
        min_voxels: Smaller groups are left out.

    Returns:
        Sorted positions in `means`, one array an object.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if not len(means):
        return []
    cells, voxel = np.unique(np.floor(means / voxel_m).astype(np.int64), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(TOUCHING, output_type="ndarray")
    touching = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(cells),) * 2)
    groups, group = connected_components(touching, directed=False)
    sizes = np.bincount(group, minlength=groups)
    owner = group[voxel.ravel()]
    large = [number for number in np.argsort(-sizes, kind="stable").tolist() if sizes[number] >= min_voxels]
    return [np.flatnonzero(owner == number) for number in large]


def _notes(context: SceneContext, config: VoxelCaptionsConfig) -> tuple[str, ...]:
    scene = context.scene
    found: list[tuple[str, Int32[np.ndarray, "_"]]] = []
    for category in context.vocabulary:
        if category not in config.background:
            ids = ids_with_label(scene.semantics, category)
            objects = voxel_objects(scene.gaussians.means[ids], config.voxel_m, config.min_voxels)
            found += [(category, ids[positions]) for positions in objects]
    boxes = [object_box(scene, category, ids) for category, ids in found]
    boxes = sorted(boxes, key=lambda box: -float(np.prod(box.size)))[: config.max_objects]
    notes = []
    for number, (box, place) in enumerate(zip(boxes, place_notes(boxes), strict=True)):
        color = dominant_color(0.5 + SH_C0 * scene.gaussians.sh[box.ids, 0].astype(np.float64))
        noun = f"{color} {box.name}".strip()
        notes.append(f"Object {number}: There is {'an' if noun[0] in 'aeiou' else 'a'} {noun}. {place}")
    return tuple(notes)


def _gather(
    context: SceneContext, question: Question, evidence: Evidence, config: VoxelCaptionsConfig, watch: Stopwatch
) -> Material:
    with watch.stage("objects", 1):
        notes = once(context, config, lambda: _notes(context, config))
    return Material(notes=notes, objects=len(notes))


async def _answer(question: Question, material: Material, caller: Caller, calls: list[CallRow]) -> TaskAnswer:
    return await answer_notes(question, material.notes, "objects", caller, calls)


VOXEL_CAPTIONS = BaselineSteps("voxel_captions", "eqa", _gather, _answer)
"""OpenEQA's sparse voxel map captions, from the scene's labels."""
