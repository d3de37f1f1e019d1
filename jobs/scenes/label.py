"""Ground truth onto a scene of one's own: a new scene folder with categories and instances from labelled points."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schemas import storage
from schemas.errors import InputError

if TYPE_CHECKING:
    from pipeline.construct.distillation.distill import DistillConfig

NEAR_SIGMA = 3.0
DOUBTFUL = 0.5
"""Share of Gaussians with a point within three sigma under which scene and points seem to lie in different coordinates:
on scene0000_00 it is 0.92, 0.45 when moved by 10 cm on each axis, and 0.06 in aligned coordinates."""


@dataclass(frozen=True, slots=True)
class LabelledScene:
    """A scene folder that was written."""

    uri: str
    """Path or URI."""
    gaussians: int
    """M."""
    labelled: float
    """Share of Gaussians with a label, 0 to 1."""
    purity: float
    """Mean share of the winning label in the weight of a labelled Gaussian, 0 to 1."""
    near: float
    """Share of Gaussians with a point within three sigma, 0 to 1."""
    instances: int
    """Instances with Gaussians."""
    warnings: tuple[str, ...]
    """What looks wrong, one line each."""


def label_scene(
    scene: str,
    source: str,
    output: str,
    config: DistillConfig | None = None,
    *,
    keep_categories: bool = False,
    threads: int = 1,
) -> LabelledScene:
    """Write a copy of a scene whose instances and categories come from labelled points.

    Its questions are copied, its embeddings kept; its objects are those of the source where that has some.

    Args:
        scene: Scene folder.
        source: A ScanNet scan's folder, or an NPZ file (`read_labelled_points`).
        output: Folder of the new scene.
        config: Which points count.
        keep_categories: Leave the scene's own categories as they are and write instances only.
        threads: Chunks of Gaussians side by side.

    Raises:
        InputError: The output is the scene itself, there is nothing to write, or scene or source is wrong.
    """
    from pipeline.construct.distillation.ground_truth import ground_truth
    from pipeline.construct.distillation.labelled_points import read_labelled_points
    from pipeline.scene.load import load_objects, load_scene
    from pipeline.scene.save import save_scene
    from pipeline.scene.scene_file import QUESTIONS
    from pipeline.scene.semantics import UNLABELLED, Semantics

    if _place(output) == _place(scene):
        raise InputError(output, field="output", expected="another folder than the scene's", found="the same")
    points = read_labelled_points(source)
    if keep_categories and points.instance is None:
        raise InputError(
            source, field="instance", expected="instances, to add to the scene's own categories", found="none"
        )
    loaded = load_scene(scene)
    truth = ground_truth(loaded.gaussians, points, config, threads=threads)
    own = loaded.semantics
    named = (own.vocabulary, own.category)
    if truth.category is not None and not keep_categories:
        named = (points.vocabulary, truth.category)
    instance = own.instance if truth.instance is None else truth.instance
    objects = points.objects or load_objects(scene)
    if storage.exists(storage.join(scene, QUESTIONS)):
        # Before the scene, whose scene.json is written last: a folder that has one is whole.
        storage.write_bytes_atomic(storage.join(output, QUESTIONS), storage.read_bytes(storage.join(scene, QUESTIONS)))
    save_scene(dataclasses.replace(loaded, semantics=Semantics(*named, own.embedding, instance)), output, objects)
    known = truth.votes.label != UNLABELLED
    present = set() if instance is None else set(np.unique(instance[instance >= 0]).tolist())
    near = float((truth.votes.nearest <= NEAR_SIGMA).mean())
    warnings = list(points.warnings)
    if near < DOUBTFUL:
        warnings.append(
            f"only {near:.1%} of Gaussians have a point within {NEAR_SIGMA:.0f} sigma: are scene and points in the "
            "same coordinates? (a ScanNet mesh is in those of its poses, not axis-aligned)"
        )
    if bare := [item for item in objects if item.instance not in present]:
        warnings.append(
            f"{len(bare)} of {len(objects)} objects have no Gaussian, such as {bare[0].category} {bare[0].instance}"
        )
    return LabelledScene(
        uri=output,
        gaussians=len(loaded.gaussians),
        labelled=float(known.mean()),
        purity=float(truth.votes.purity[known].mean()),
        near=near,
        instances=len(present),
        warnings=tuple(warnings),
    )


def _place(uri: str) -> str:
    path = storage.local_path(uri)
    return storage.join(uri) if path is None else str(path.resolve())
