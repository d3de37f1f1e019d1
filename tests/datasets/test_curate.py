"""Referring sets: every target has a rival, every question one answer, and faults are found."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pipeline.datasets import curate_referring, load_dataset_questions, referring_faults
from pipeline.datasets.curate import ReferringSet
from pipeline.scene.objects import SceneObject
from schemas.question_file import save_questions
from tests.scene.home import build_home

HOME = tuple(o for o in build_home() if o.room in ("kitchen", "office"))
"""Part of the home: describing all of it takes a second."""
SCENES = {"home": HOME, "other": tuple(replace(o, instance=o.instance + 100) for o in HOME)}


@cache
def curate(seed: int = 0, **options: int) -> ReferringSet:
    return curate_referring(SCENES, np.random.default_rng(seed), **options)


def test_every_target_has_a_rival_of_its_category() -> None:
    made = curate(count=20)
    assert len(made.questions) == 20
    for q, candidates in zip(made.questions, made.candidates, strict=True):
        objects = {o.instance: o.category for o in SCENES[q.scene]}
        assert q.target_ids is not None
        (target,) = q.target_ids
        assert objects[target] == q.target_category
        assert list(objects.values()).count(objects[target]) == candidates >= 2
    assert referring_faults(made.questions, SCENES) == ()


def test_queries_are_questions_of_one_target() -> None:
    made = curate(count=30)
    assert {q.task for q in made.questions} == {"ground_one"}
    assert all(q.question.endswith("?") for q in made.questions)
    assert len({(q.scene, q.question) for q in made.questions}) == len(made.questions)


def test_questions_are_spread_evenly_over_scenes() -> None:
    scenes = [q.scene for q in curate(count=11).questions]
    assert (scenes.count("home"), scenes.count("other")) == (6, 5)


def test_a_poor_scene_is_made_up_for_by_the_others() -> None:
    scenes = {"poor": SCENES["home"][:1], **SCENES}
    made = curate_referring(scenes, np.random.default_rng(0), count=12)
    assert [sum(q.scene == s for q in made.questions) for s in scenes] == [0, 6, 6]


def test_more_distractors_may_be_asked_for() -> None:
    made = curate(count=10, least_distractors=2)
    assert made.questions
    assert min(made.candidates) >= 3


def test_the_same_seed_gives_the_same_set() -> None:
    assert curate(seed=3, count=9) == curate.__wrapped__(seed=3, count=9)
    assert curate(seed=3, count=9) != curate(seed=4, count=9)


def test_a_set_is_written_and_loaded_as_a_referring_file(tmp_path: Path) -> None:
    made = curate(count=8)
    save_questions(made.questions, tmp_path / "referring.jsonl")
    assert load_dataset_questions("referring", str(tmp_path / "referring.jsonl")) == made.questions
    assert load_dataset_questions("jsonl", str(tmp_path / "referring.jsonl")) == made.questions


def test_summary_counts_questions_scenes_and_candidates() -> None:
    assert curate(count=6).summary.startswith("6 questions, 2 scenes, 2 to ")
    assert ReferringSet((), ()).summary == "0 questions"


def test_nothing_to_curate_gives_an_empty_set() -> None:
    assert curate_referring({"empty": ()}, np.random.default_rng(0)).questions == ()
    with pytest.raises(ValueError, match="at least 1, got 0"):
        curate(count=0)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"question": "the red chair"}, "is no question"),
        ({"scene": "elsewhere"}, "scene 'elsewhere' is not known"),
        ({"target_ids": (1, 2)}, "has 2 targets, not one"),
        ({"target_ids": None}, "has 0 targets, not one"),
        ({"target_ids": (9999,)}, "the scene has no object 9999"),
    ],
)
def test_faults_are_named(change: dict[str, object], fault: str) -> None:
    good = curate(count=4).questions
    faults = referring_faults([replace(good[0], **change), *good[1:]], SCENES)  # type: ignore[arg-type]
    assert [line for line in faults if fault in line and good[0].question_id in line]
    assert len(faults) == 1


def test_a_target_without_rivals_is_a_fault() -> None:
    good = curate(count=1).questions[0]
    objects = SCENES[good.scene]
    alone = tuple(o for o in objects if o.category != good.target_category or (o.instance,) == good.target_ids)
    (fault,) = referring_faults([good], {good.scene: alone})
    assert "has 0 others of its category" in fault


def test_a_question_with_two_answers_is_a_fault_on_both() -> None:
    good = curate(count=1).questions[0]
    rival = next(
        o for o in SCENES[good.scene] if o.category == good.target_category and (o.instance,) != good.target_ids
    )
    twin = replace(good, question_id="twin", question=good.question.upper(), target_ids=(rival.instance,))
    faults = referring_faults([good, twin], SCENES)
    assert len(faults) == 2
    assert all("asked twice with different targets" in fault for fault in faults)


def test_real_scans_give_a_set_of_the_papers_size(shared_data: Path) -> None:
    entries = json.loads((shared_data / "scanrefer/objects_info_val.json").read_text())
    scenes = {
        scene: tuple(
            SceneObject(e["id"], e["label"], "", tuple(e["center_position"]), tuple(s / 2 for s in e["size"]))
            for e in found
        )
        for scene, found in list(entries.items())[:5]
    }
    made = curate_referring(scenes, np.random.default_rng(0))
    assert len(made.questions) == 49
    assert len({q.scene for q in made.questions}) == 5
    assert referring_faults(made.questions, scenes) == ()
