"""Referring segmentation sets: questions whose target must be told from others of its category.

The paper's set has 49 question-form queries over five ScanNet scenes, each of one target among candidates of the same
category, with targets marked by hand (supplement, "3D Referring Segmentation Dataset Curation"). Here questions and
targets are computed from the scenes' objects by `pipeline.scene.questions`, whose descriptions denote one object in
the strict and in the most lenient reading; `referring_faults` checks a set from any hand.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.datasets.referring import CATEGORY
from pipeline.scene.objects import SceneObject
from pipeline.scene.questions.generate import choose
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.referring import referring
from pipeline.scene.questions.world import build_world
from schemas.questions import Question

PAPER_QUESTIONS = 49
"""Queries of the paper's set."""
_QUESTION_WORDS = ("which", "what", "where", "who", "can", "could", "is", "are", "do", "does", "how")


@dataclass(frozen=True, slots=True)
class ReferringSet:
    """A curated set."""

    questions: tuple[Question, ...]
    """By scene, in the order the scenes were given."""
    candidates: tuple[int, ...]
    """Objects of the target's category for each question, the target included: at least 2."""

    @property
    def summary(self) -> str:
        """One line: questions, scenes and candidates."""
        if not self.questions:
            return "0 questions"
        scenes = len({question.scene for question in self.questions})
        low, high, mean = min(self.candidates), max(self.candidates), float(np.mean(self.candidates))
        counted = f"{_counted(len(self.questions), 'question')}, {_counted(scenes, 'scene')}"
        return f"{counted}, {low} to {high} candidates (mean {mean:.1f})"


def curate_referring(
    scenes: Mapping[str, Sequence[SceneObject]],
    rng: np.random.Generator,
    *,
    count: int = PAPER_QUESTIONS,
    least_distractors: int = 1,
) -> ReferringSet:
    """Return up to `count` question-form queries, spread over the scenes as evenly as they allow.

    The same arguments give the same set. Scenes with too little to ask about give less, and the others make up for it.

    Args:
        scenes: Objects by scene name, structure included; z is up, metres.
        rng: Source of every choice.
        count: Most questions.
        least_distractors: Other objects of the target's category a question needs, at least 1.

    Raises:
        ValueError: `count` or `least_distractors` is below 1.
    """
    if count < 1 or least_distractors < 1:
        raise ValueError(f"count and least_distractors are at least 1, got {count} and {least_distractors}")
    pools = []
    for scene, objects in scenes.items():
        # More than the share: some fall to `least_distractors`, and some make up for other scenes.
        made = _referring(scene, objects, 2 * count, rng)
        pools.append([q for q in made if len(same_category(q, objects)) > least_distractors])
    shares = _even_shares([len(pool) for pool in pools], count)
    questions = tuple(q for pool, share in zip(pools, shares, strict=True) for q in pool[:share])
    return ReferringSet(questions, tuple(len(same_category(q, scenes[q.scene])) for q in questions))


def referring_faults(
    questions: Sequence[Question], scenes: Mapping[str, Sequence[SceneObject]], *, least_distractors: int = 1
) -> tuple[str, ...]:
    """Return what is wrong with a referring set, one line a fault: none for a sound one.

    A question must be about a known scene, read as a question, have one target that the scene has, at least
    `least_distractors` others of its category beside it, and no twin with another target.

    Args:
        questions: The set.
        scenes: Objects by scene name.
        least_distractors: Other objects of the target's category that are needed.
    """
    faults = []
    targets: dict[tuple[str, str], set[tuple[int, ...] | None]] = {}
    for q in questions:
        text = " ".join(q.question.lower().split())
        targets.setdefault((q.scene, text), set()).add(q.target_ids)
    for q in questions:
        say = f"question {q.question_id!r}: "
        text = " ".join(q.question.lower().split())
        if not text.endswith("?") and text.split()[0] not in _QUESTION_WORDS:
            faults.append(say + "is no question")
        if len(targets[q.scene, text]) > 1:
            faults.append(say + "is asked twice with different targets")
        if q.scene not in scenes:
            faults.append(say + f"scene {q.scene!r} is not known")
        elif q.target_ids is None or len(q.target_ids) != 1:
            faults.append(say + f"has {len(q.target_ids or ())} targets, not one")
        elif not (alike := same_category(q, scenes[q.scene])):
            faults.append(say + f"the scene has no object {q.target_ids[0]}")
        elif len(alike) <= least_distractors:
            faults.append(
                say + f"has {len(alike) - 1} others of its category beside the target, not {least_distractors}"
            )
    return tuple(faults)


def same_category(question: Question, objects: Sequence[SceneObject]) -> tuple[int, ...]:
    """Return the instances of the target's category, the target included; empty where the scene has no such object."""
    target = question.target_ids[0] if question.target_ids else None
    category = next((o.category for o in objects if o.instance == target), None)
    return tuple(o.instance for o in objects if o.category == category) if category is not None else ()


def _referring(scene: str, objects: Sequence[SceneObject], count: int, rng: np.random.Generator) -> Iterator[Question]:
    if not objects:
        return
    world = build_world(objects, ())
    for number, draft in enumerate(choose(referring(world, Describer(world), rng), count, rng)):
        yield Question(
            question_id=f"{scene}-{CATEGORY}-{number:03d}",
            scene=scene,
            task="ground_one",
            question=draft.question,
            category=CATEGORY,
            target_ids=tuple(world.objects[i].instance for i in draft.targets),
            target_category=draft.about,
        )


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _even_shares(available: Sequence[int], count: int) -> list[int]:
    """Return how many to take of each, one by one in turn until `count` or all are taken."""
    shares: Counter[int] = Counter()
    left = min(count, sum(available))
    while left:
        for i, most in enumerate(available):
            if left and shares[i] < most:
                shares[i] += 1
                left -= 1
    return [shares[i] for i in range(len(available))]
