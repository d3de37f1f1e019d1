"""Generated questions: counts, laws of the geometry they are computed from, and answers checked another way."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.scene.objects import SceneObject
from pipeline.scene.questions import EQA_MAKERS, GROUNDING_MAKERS, generate_questions
from pipeline.scene.questions.draft import Draft
from pipeline.scene.questions.generate import choose
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.spatial import front_of, spatial
from pipeline.scene.questions.world import build_world
from schemas.questions import Question
from tests.scene.home import (
    ROOMS,
    HomeRoom,
    build_home,
    mirrored,
    mirrored_rooms,
    quarter_turn,
    quarter_turn_rooms,
)

OPENEQA = {
    "object recognition",
    "object localization",
    "attribute recognition",
    "spatial understanding",
    "object state recognition",
    "functional reasoning",
    "world knowledge",
}
EVERYTHING = 400
"""More than the home has to ask in any category."""


@cache
def ask(
    objects: tuple[SceneObject, ...], rooms: tuple[HomeRoom, ...] = ROOMS, seed: int = 0, count: int = 12
) -> tuple[Question, ...]:
    rng = np.random.default_rng(seed)
    return generate_questions(
        "home", objects, rooms, rng, per_category=count, single=count, multi=count, zero=count, referring=count
    )


@pytest.fixture(scope="module")
def home() -> tuple[SceneObject, ...]:
    return build_home()


@pytest.fixture(scope="module")
def everything(home: tuple[SceneObject, ...]) -> tuple[Question, ...]:
    return ask(home, count=EVERYTHING)


def test_questions_cover_the_seven_openeqa_categories_and_four_of_grounding(home: tuple[SceneObject, ...]) -> None:
    assert set(EQA_MAKERS) == OPENEQA
    counts = {c: sum(q.category == c for q in ask(home)) for c in (*EQA_MAKERS, *GROUNDING_MAKERS)}
    assert set(counts.values()) == {12}, counts


def test_questions_have_distinct_ids_and_texts_within_a_category(everything: tuple[Question, ...]) -> None:
    assert len({q.question_id for q in everything}) == len(everything)
    assert len({(q.category, q.question) for q in everything}) == len(everything)


def test_same_seed_gives_the_same_questions_and_another_seed_others(home: tuple[SceneObject, ...]) -> None:
    again = ask.__wrapped__(home)
    assert ask(home) == again
    assert ask(home) != ask(home, seed=1)


def test_tasks_targets_and_answers_fit_their_category(everything: tuple[Question, ...]) -> None:
    for q in everything:
        assert q.target_category, q
        assert q.target_ids is not None, q
        if q.category in OPENEQA:
            assert q.task == "eqa", q
            assert q.answer, q
            assert q.answer not in q.extra_answers, q
        else:
            assert q.answer is None, q
            few = {"single-target": (1,), "referring": (1,), "zero-target": (0,)}.get(q.category, range(2, 20))
            assert len(q.target_ids) in few, q
            assert q.task == ("ground_one" if few == (1,) else "ground_many"), q


def test_structure_is_never_a_target(home: tuple[SceneObject, ...], everything: tuple[Question, ...]) -> None:
    structure = {o.instance for o in home if o.category in ("wall", "floor")}
    assert not structure & {i for q in everything for i in q.target_ids or ()}


def test_questions_and_answers_survive_a_quarter_turn(home: tuple[SceneObject, ...]) -> None:
    assert ask(quarter_turn(home), quarter_turn_rooms()) == ask(home)


def test_left_and_right_change_places_in_a_mirror_and_nothing_else_does(home: tuple[SceneObject, ...]) -> None:
    plain = ask(home, count=EVERYTHING)
    swapped = ask(mirrored(home), mirrored_rooms(), count=EVERYTHING)
    sided = [q for q in plain if re.search(r"\bleft\b.*\bright\b", q.question)]
    assert len(sided) > 20
    assert {q.question for q in plain} == {q.question for q in swapped}
    answers = {q.question: q.answer for q in swapped}
    for q in plain:
        if q in sided:
            assert q.answer is not None
            expected: str | None = q.answer.replace("left", "R").replace("right", "left").replace("R", "right")
        else:
            expected = q.answer
        assert answers[q.question] == expected, q


def test_numbering_of_instances_does_not_matter(home: tuple[SceneObject, ...]) -> None:
    shift = 1000
    moved = tuple(
        replace(o, instance=o.instance + shift, parent=o.parent + shift if o.parent >= 0 else -1) for o in home
    )
    for before, after in zip(ask(home), ask(moved), strict=True):
        assert replace(after, target_ids=before.target_ids) == before
        assert after.target_ids == tuple(i + shift for i in before.target_ids or ())


def test_color_answers_are_the_colors_of_the_targets(
    home: tuple[SceneObject, ...], everything: tuple[Question, ...]
) -> None:
    asked = [q for q in everything if q.category == "attribute recognition" and "color" in q.question.lower()]
    assert len(asked) > 30
    for q in asked:
        assert {home[i].color for i in q.target_ids or ()} == {(q.answer or "").lower()}, q


def test_counts_agree_with_counting_by_hand(home: tuple[SceneObject, ...], everything: tuple[Question, ...]) -> None:
    by_question = {q.question: q.answer for q in everything}
    counted = {
        (place, noun): answer
        for question, answer in by_question.items()
        for noun, place in re.findall(
            r"^(?:How many|What is the number of) (.+?) (?:are there |can you count )?(in total|in the .+)\?$", question
        )
    }
    assert counted[("in the bedroom", "pillows")] == "2"
    assert counted[("in the kitchen", "chairs")] == "4"
    assert counted[("in total", "trash cans")] == "2"


def test_state_answers_agree_with_the_states(home: tuple[SceneObject, ...], everything: tuple[Question, ...]) -> None:
    asked = [q for q in everything if re.search(r"\b(open|closed|on|off) or (open|closed|on|off)\?$", q.question)]
    assert len(asked) > 5
    for q in asked:
        (target,) = q.target_ids or ()
        assert (q.answer or "").lower() in home[target].states, q


@pytest.mark.parametrize(
    ("pattern", "answer", "targets"),
    [
        (r"under(neath)? the (brown )?desk( .*)?\?", "A trash can", {"trash can"}),
        (r"^(what|which object) .*behind the (gray )?couch( .*)?\?", "A ball", {"ball"}),
        (r"^(what|which object) .*(in|inside) the (gray )?counter( .*)?\?", "A sink", {"sink"}),
        (r"where .*\b(do|is|did|can).* the red backpack", "On the bed in the bedroom", {"backpack"}),
        (r"(wash my hands|hands are dirty|clean my fingers)", "sink", {"sink"}),
        (r"in which room would i sleep at night\?", "The bedroom", {"bed"}),
    ],
)
def test_known_facts_of_the_home_are_answered_right(
    home: tuple[SceneObject, ...], everything: tuple[Question, ...], pattern: str, answer: str, targets: set[str]
) -> None:
    asked = [q for q in everything if q.task == "eqa" and re.search(pattern, q.question.lower())]
    asked = [q for q in asked if q.answer not in ("Yes", "No")]
    assert asked
    for q in asked:
        assert answer in (q.answer or ""), q
        assert {home[i].category for i in q.target_ids or ()} == targets, q


def test_zero_target_names_nothing_of_that_category_color_and_place(
    home: tuple[SceneObject, ...], everything: tuple[Question, ...]
) -> None:
    colored = re.compile(r"\b(black|white|gray|red|green|blue|yellow|orange|purple|pink|brown) (.+?)(?: |\.|$)")
    for q in everything:
        if q.category != "zero-target":
            continue
        there = {(o.color, o.category) for o in home}
        match = colored.search(q.question)
        if match and q.question.endswith(match[0]):
            assert (match[1], match[2]) not in there, q
        if not re.search(r" (in|on|under|next|above|behind) ", q.question) and not match:
            assert not any(o.category == q.target_category for o in home), q


def test_front_of_a_thing_at_a_wall_points_into_the_room(home: tuple[SceneObject, ...]) -> None:
    world = build_world(home, ROOMS)
    fronts = {o.category: front_of(world, i) for i, o in enumerate(home)}
    desk, table = fronts["desk"], fronts["dining table"]
    assert desk is not None
    np.testing.assert_allclose(desk, [0, -1], atol=1e-9)
    assert table is None


def test_sides_agree_with_the_turn_from_one_object_to_the_other(home: tuple[SceneObject, ...]) -> None:
    world = build_world(home, ROOMS)
    drafts = list(spatial(world, Describer(world), np.random.default_rng(0)))
    walks = [d for d in drafts if d.kind == "side seen by a walker"]
    faced = [d for d in drafts if d.kind == "side of a thing one faces"]
    assert min(len(walks), len(faced)) > 5
    for draft in walks:
        thing, start, goal = (np.array(home[i].center) for i in draft.targets)
        turn = np.cross(goal - start, thing - start)[2]
        assert draft.answer == ("On the left" if turn > 0 else "On the right")
    backpack = [d for d in faced if [home[i].category for i in d.targets] == ["backpack", "desk"]]
    assert {d.answer for d in backpack} == {"To the right"}


def test_closer_answers_agree_with_distances(home: tuple[SceneObject, ...]) -> None:
    world = build_world(home, ROOMS)
    describer = Describer(world)
    texts = {phrase.text: i for i in world.askable for phrase in describer.plain[i]}
    drafts = [d for d in spatial(world, describer, np.random.default_rng(0)) if d.kind == "closer"]
    assert len(drafts) > 10
    for draft in drafts:
        _, anchor = draft.targets
        match = re.search(r"(?:, |: |^Is )the (.+) or the (.+?)(?: closer to the .+)?\?$", draft.question)
        assert match, draft.question
        nearest = min(match.groups(), key=lambda text: float(world.layout.distance[anchor, texts[text]]))
        assert draft.answer == f"The {nearest}"


def test_a_scan_gets_no_question_whose_answer_is_that_nothing_is_there(home: tuple[SceneObject, ...]) -> None:
    scan = tuple(replace(o, room="", parent=-1, relation="", states=()) for o in home)
    questions = ask(scan, (), count=EVERYTHING)
    assert {q.answer for q in questions} & {"No", "0"} == set()
    names = {o.category for o in home}
    assert {q.target_category for q in questions} <= names


@pytest.mark.parametrize("objects", [(), build_home()[:2], build_home()[2:3]])
def test_scenes_with_little_or_nothing_to_ask_give_few_questions(objects: tuple[SceneObject, ...]) -> None:
    questions = generate_questions("bare", objects, (), np.random.default_rng(0))
    assert len(questions) <= 25


def test_choose_takes_kinds_in_turn_and_varies_targets() -> None:
    drafts = [Draft(kind, f"{kind} {t} {n}", "Yes", (t,), "x") for kind in "ab" for t in range(3) for n in range(5)]
    chosen = choose(drafts, 6, np.random.default_rng(0))
    assert sorted((d.kind, d.targets) for d in chosen) == [(k, (t,)) for k in "ab" for t in range(3)]
