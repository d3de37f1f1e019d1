"""Question generation: drafts of every form, chosen in turn so that forms, objects and answers vary."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from pipeline.scene.objects import SceneObject
from pipeline.scene.questions.attributes import attributes
from pipeline.scene.questions.draft import Draft
from pipeline.scene.questions.functional import functional, knowledge
from pipeline.scene.questions.grounding import none, several, single
from pipeline.scene.questions.localization import localization
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.recognition import recognition
from pipeline.scene.questions.referring import referring
from pipeline.scene.questions.spatial import spatial
from pipeline.scene.questions.states import states
from pipeline.scene.questions.world import Room, World, build_world
from schemas.questions import Question, Task

Maker = Callable[[World, Describer, np.random.Generator], Iterator[Draft]]

EQA_MAKERS: dict[str, Maker] = {
    "object recognition": recognition,
    "object localization": localization,
    "attribute recognition": attributes,
    "spatial understanding": spatial,
    "object state recognition": states,
    "functional reasoning": functional,
    "world knowledge": knowledge,
}
"""The seven OpenEQA categories, by their official names."""

GROUNDING_MAKERS: dict[str, tuple[Task, Maker]] = {
    "single-target": ("ground_one", single),
    "multi-target": ("ground_many", several),
    "zero-target": ("ground_many", none),
    "referring": ("ground_one", referring),
}
"""Grounding categories and their tasks."""


def generate_questions(
    scene_name: str,
    objects: Sequence[SceneObject],
    rooms: Sequence[Room],
    rng: np.random.Generator,
    *,
    per_category: int = 10,
    single: int = 15,
    multi: int = 10,
    zero: int = 5,
    referring: int = 10,
) -> tuple[Question, ...]:
    """Return questions about a scene, with answers and targets computed from its objects' boxes.

    The same arguments give the same questions. A scene that has too little to ask about gives fewer than asked for,
    never a question whose answer is not plain.

    Args:
        scene_name: Name of the scene; ids start with it.
        objects: Every object, structure included; z is up, metres.
        rooms: The scene's rooms; may be empty.
        rng: Source of every choice.
        per_category: Questions in each of the seven OpenEQA categories.
        single: Descriptions of one object.
        multi: Descriptions of several objects.
        zero: Descriptions of nothing that is there.
        referring: Questions that single out one of several like things.

    Returns:
        Questions grouped by category, in the order of `EQA_MAKERS` and `GROUNDING_MAKERS`.
    """
    if not objects:
        return ()
    world = build_world(objects, rooms)
    describer = Describer(world)
    questions: list[Question] = []
    for category, maker in EQA_MAKERS.items():
        chosen = choose(maker(world, describer, rng), per_category, rng)
        questions += _numbered(scene_name, "eqa", category, chosen, world)
    for (category, (task, maker)), count in zip(
        GROUNDING_MAKERS.items(), (single, multi, zero, referring), strict=True
    ):
        chosen = choose(maker(world, describer, rng), count, rng)
        questions += _numbered(scene_name, task, category, chosen, world)
    return tuple(questions)


def choose(drafts: Iterable[Draft], count: int, rng: np.random.Generator) -> list[Draft]:
    """Return up to `count` drafts, taking the kinds in turn and, within a kind, the least used targets and answers."""
    by_kind: defaultdict[str, list[Draft]] = defaultdict(list)
    for draft in drafts:
        by_kind[draft.kind].append(draft)
    pools = [[by_kind[kind][i] for i in rng.permutation(len(by_kind[kind]))] for kind in sorted(by_kind)]
    pools = [pools[i] for i in rng.permutation(len(pools))]
    chosen: list[Draft] = []
    asked: set[str] = set()
    used: Counter[object] = Counter()
    while len(chosen) < count and pools:
        for pool in list(pools):
            best = min(pool, key=lambda d: (used[d.targets] + used[d.about], used[d.answer]))
            pool.remove(best)
            if not pool:
                pools.remove(pool)
            if best.question not in asked and len(chosen) < count:
                chosen.append(best)
                asked.add(best.question)
                used.update([best.targets, best.about, best.answer])
    return chosen


def _numbered(scene: str, task: Task, category: str, drafts: list[Draft], world: World) -> list[Question]:
    slug = category.replace(" ", "-")
    return [
        Question(
            question_id=f"{scene}-{slug}-{number:03d}",
            scene=scene,
            task=task,
            question=draft.question,
            answer=draft.answer,
            extra_answers=draft.extra_answers,
            category=category,
            target_ids=tuple(sorted(world.objects[i].instance for i in draft.targets)),
            target_category=draft.about,
        )
        for number, draft in enumerate(drafts)
    ]
