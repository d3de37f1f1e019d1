"""A referring segmentation set from the objects of scene folders, checked and written as one question file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jobs.dataset import find_scenes
from jobs.runs.problems import Problems
from schemas.errors import InputError

if TYPE_CHECKING:
    from pipeline.datasets.curate import ReferringSet


def curate_scenes(
    scenes: Sequence[str], output: str, *, count: int, least_distractors: int = 1, seed: int = 0
) -> ReferringSet:
    """Write up to `count` question-form queries about scenes, spread over them as evenly as they allow.

    Args:
        scenes: Folders, URIs or patterns; each needs objects.json.
        output: JSONL file, a path or URI; replaced where there is one.
        count: Most questions.
        least_distractors: Other objects of the target's category a question needs.
        seed: Fixes every choice.

    Raises:
        InputError: A scene is missing or has no objects, two share a name, or nothing can be asked.
    """
    from pipeline.datasets.curate import curate_referring
    from pipeline.scene.load import load_objects
    from pipeline.scene.scene_file import OBJECTS, find_parts
    from schemas.question_file import save_questions

    problems, objects = Problems(), {}
    for uri in find_scenes(scenes, "curate", problems):
        try:
            name = find_parts(uri).name
            if name in objects:
                raise InputError(uri, field="name", expected="a name no other scene has", found=name)
            objects[name] = load_objects(uri)
            if not objects[name]:
                raise InputError(uri, field=OBJECTS, expected="the scene's objects", found="none")
        except InputError as error:
            problems.add(error)
    problems.refuse()
    made = curate_referring(objects, np.random.default_rng(seed), count=count, least_distractors=least_distractors)
    if not made.questions:
        expected = f"an object that can be told from {least_distractors} or more others of its category"
        raise InputError("curate", field="scenes", expected=expected, found=f"none in {', '.join(objects)}")
    save_questions(made.questions, output)
    return made
