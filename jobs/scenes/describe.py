"""Categories or features onto a scene of one's own: a new scene folder, described by a source that sees its views."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas import storage
from schemas.errors import InputError

if TYPE_CHECKING:
    from pipeline.construct.semantics.describe import SemanticsConfig


@dataclass(frozen=True, slots=True)
class DescribedScene:
    """A scene folder that was written."""

    uri: str
    """Path or URI."""
    gaussians: int
    """M."""
    labelled: float
    """Share of Gaussians with a category or a feature, 0 to 1."""
    categories: int
    """Categories that at least one Gaussian carries."""
    photographs: int
    """Views the source saw as photographs; it saw the others rendered."""
    rendered: int
    """Views it saw rendered."""
    warnings: tuple[str, ...]
    """What a reader should know, one line each."""


def describe_scene(
    scene: str,
    config: SemanticsConfig,
    output: str,
    *,
    threads: int = 1,
    progress: Callable[[int, int], object] = lambda done, total: None,
) -> DescribedScene:
    """Write a copy of a scene whose categories or features come from a 2D source.

    The source sees each recorded view's photograph, or its render where there is none. Ground-truth instances, objects
    and questions are kept.

    Args:
        scene: Scene folder.
        config: Source and registration.
        output: Folder of the new scene.
        threads: Views registered side by side.
        progress: Called with the number of views done, and of all.

    Raises:
        InputError: The output is the scene itself, or scene or source is wrong.
    """
    from pipeline.construct.semantics.describe import describe
    from pipeline.construct.semantics.labels_2d.scene_frames import rendered_frames
    from pipeline.scene.captures.image_files import ImageFile
    from pipeline.scene.load import load_objects, load_scene
    from pipeline.scene.save import save_scene
    from pipeline.scene.scene_file import QUESTIONS

    if storage.join(output) == storage.join(scene):
        raise InputError(output, field="output", expected="another folder than the scene's", found="the same")
    loaded = load_scene(scene)
    frames = [
        frame if view.image is None else dataclasses.replace(frame, image=ImageFile(view.image))
        for frame, view in zip(rendered_frames(loaded.gaussians, loaded.views), loaded.views, strict=True)
    ]
    found = describe(
        loaded.gaussians,
        frames,
        config,
        scene=loaded.name,
        threads=threads,
        progress=lambda done: progress(done, len(frames)),
    )
    # Instances of the source are its own; ground truth is the scene's.
    instance = loaded.semantics.instance if loaded.semantics.instance is not None else found.semantics.instance
    semantics = dataclasses.replace(found.semantics, instance=instance)
    if storage.exists(storage.join(scene, QUESTIONS)):
        # Before the scene, whose scene.json is written last: a folder that has one is whole.
        storage.write_bytes_atomic(storage.join(output, QUESTIONS), storage.read_bytes(storage.join(scene, QUESTIONS)))
    objects = load_objects(scene) or (found.objects if loaded.semantics.instance is None else ())
    save_scene(dataclasses.replace(loaded, semantics=semantics, texts=found.texts), output, objects)
    photographs = sum(view.image is not None for view in loaded.views)
    return DescribedScene(
        uri=output,
        gaussians=len(loaded.gaussians),
        labelled=semantics.labelled_share,
        categories=len(semantics.present()),
        photographs=photographs,
        rendered=len(frames) - photographs,
        warnings=found.warnings,
    )
