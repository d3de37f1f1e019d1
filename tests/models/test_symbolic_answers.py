"""Answers of one view and of several, from views of painted boxes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.models.messages import ImagePart
from pipeline.models.symbolic.answer import Answer
from pipeline.models.symbolic.answer_view import answer_view
from pipeline.models.symbolic.certainty import CANNOT_TELL, Certainty, certainty_of
from pipeline.models.symbolic.combine import answer_many, answer_one
from pipeline.models.symbolic.parse_question import parse_question
from pipeline.models.symbolic.perceive import perceive
from pipeline.scene.procedural.vocabulary import VOCABULARY
from tests.models.symbolic_painting import RGB, Box, paint, room

BEDROOM = room(
    Box("bed", (0, 3.6), (1.6, 0.5, 2.0), color="white"),
    Box("pillow", (-0.4, 4.2), (0.5, 0.15, 0.35), foot=0.5, color="blue"),
    Box("nightstand", (1.1, 4.2), (0.45, 0.55, 0.4), color="brown"),
    Box("lamp", (1.1, 4.2), (0.25, 0.4, 0.2), foot=0.55, color="yellow"),
    Box("picture", (0, 4.98), (0.6, 0.5, 0.04), foot=1.5, color="green"),
    Box("desk", (-1.7, 3.5), (1.0, 0.05, 0.6), foot=0.7, color="brown"),
    Box("desk", (-2.15, 3.5), (0.08, 0.7, 0.5), color="brown"),
    Box("desk", (-1.25, 3.5), (0.08, 0.7, 0.5), color="brown"),
    Box("trash can", (-1.7, 3.5), (0.3, 0.35, 0.3), color="black"),
)


def ask(question: str, image: ImagePart) -> Answer:
    return answer_view(parse_question(question, VOCABULARY), perceive(image))


def ask_all(question: str, *images: ImagePart) -> tuple[int, str]:
    return answer_one(parse_question(question, VOCABULARY), [perceive(image) for image in images])


@pytest.fixture(scope="module")
def bedroom() -> ImagePart:
    return paint(BEDROOM)


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("What color is the lamp?", "The lamp is yellow."),
        ("Is the lamp red or yellow?", "The lamp is yellow."),
        ("What is on the nightstand?", "There is a lamp on the nightstand."),
        ("What black thing is under the desk?", "There is a trash can under the desk."),
        ("Where is the pillow?", "The pillow is on the bed in the bedroom."),
        ("How many pillows are there?", "There is one pillow."),
        ("Is there a pillow on the bed?", "Yes, there is a pillow on the bed."),
        ("Is there anything on the bed?", "Yes, there is a pillow on the bed."),
        ("Is the lamp yellow?", "Yes, the lamp is yellow."),
        ("Is the pillow red?", "No, the pillow is blue."),
        ("Is the lamp on the desk?", "No, the lamp is on the nightstand."),
        ("Is the lamp to the left or right of the bed?", "The lamp is on the right of the bed."),
        ("Is the picture above or below the bed?", "The picture is above the bed."),
        ("Which room is this?", "This is the bedroom."),
        ("Where can I sleep?", "You can use the bed in the bedroom."),
        ("What is the lamp used for?", "The lamp is used for giving light."),
        ("Are the bed and the nightstand in the same room?", "Yes, they are in the same room."),
        ("the blue pillow on the bed", "The blue pillow is on the bed."),
        ("Which is closer to the bed, the nightstand or the trash can?", "The nightstand."),
    ],
)
def test_answer_view_states_what_the_view_shows(question: str, answer: str, bedroom: ImagePart) -> None:
    found = ask(question, bedroom)

    assert found.text == answer
    assert found.certainty == Certainty.DEFINITE


@pytest.mark.parametrize(
    ("question", "certainty"),
    [
        ("What color is the couch?", Certainty.UNKNOWN),
        ("What is on the couch?", Certainty.UNKNOWN),
        ("Is the couch open?", Certainty.UNKNOWN),
        ("Which is closer to the piano, the bed or the desk?", Certainty.UNKNOWN),
        ("Why is the lamp yellow?", Certainty.UNKNOWN),
        ("Is there a cat on the bed?", Certainty.UNSEEN),
        ("Is there a couch?", Certainty.UNSEEN),
        ("the red pillow on the bed", Certainty.UNSEEN),
        ("What is the bed made of?", Certainty.UNKNOWN),
        ("What is the desk made of?", Certainty.HEDGED),
    ],
)
def test_answer_view_says_when_it_cannot_tell(question: str, certainty: Certainty, bedroom: ImagePart) -> None:
    found = ask(question, bedroom)

    assert found.certainty == certainty
    assert (found.text == CANNOT_TELL) == (certainty == Certainty.UNKNOWN)


def test_certainty_of_the_text_is_that_of_the_answer(bedroom: ImagePart) -> None:
    for question in ("What color is the lamp?", "What is the desk made of?", "Is there a cat?", "What is in the oven?"):
        answer = ask(question, bedroom)
        assert certainty_of(answer.text) == answer.certainty


def test_small_things_are_named_with_a_hedge() -> None:
    answer = ask("What color is the ball?", paint(room(Box("ball", (0, 3.0), (0.13, 0.13, 0.13), color="red"))))

    assert answer.text == "It looks like the ball is red."
    assert answer.certainty == Certainty.HEDGED


def test_moving_aside_reveals_what_stands_behind() -> None:
    boxes = room(
        Box("couch", (0, 3.0), (1.8, 0.8, 0.8), color="blue"), Box("backpack", (0.3, 3.8), (0.4, 0.7, 0.3), color="red")
    )
    question = "What is behind the couch?"

    assert ask(question, paint(boxes, eye=(0, 1.0, 0))).certainty < Certainty.HEDGED
    assert ask(question, paint(boxes, eye=(0, 2.2, 0), pitch=25.0)).content == "backpack"


@pytest.mark.parametrize(("shade", "answer"), [((255, 250, 240), "Yes"), ((150, 120, 90), "No")])
def test_a_lamp_is_on_when_it_glows(shade: tuple[int, int, int], answer: str) -> None:
    image = paint(
        room(
            Box("lamp", (0, 3.0), (0.4, 0.3, 0.4), foot=1.0, color="pink"),
            Box("lamp", (0, 3.0), (0.2, 1.0, 0.2), color="black"),
        )
    )
    image.color[image.color[:, :, 0] == 240] = shade

    assert ask("Is the lamp on?", image).text.startswith(answer)


def test_a_door_ajar_is_open_and_one_in_its_wall_is_closed() -> None:
    leaf_in_wall = Box("door", (0, 4.98), (0.9, 2.0, 0.05), color="brown")
    leaf_ajar = Box("door", (0, 4.0), (0.9, 2.0, 0.05), color="brown")

    assert ask("Is the door open or closed?", paint(room(leaf_in_wall), pitch=5)).content == "closed"
    assert ask("Is the door open or closed?", paint(room(leaf_ajar), pitch=5)).content == "open"


def test_a_cabinet_one_looks_into_is_open() -> None:
    def cabinet(front: bool) -> list[Box]:
        walls = [
            Box("cabinet", (-0.55, 3.0), (0.1, 1.2, 0.6)),
            Box("cabinet", (0.55, 3.0), (0.1, 1.2, 0.6)),
            Box("cabinet", (0, 3.25), (1.0, 1.2, 0.1)),
            Box("cabinet", (0, 3.0), (1.2, 0.1, 0.6), foot=1.2),
        ]
        return room(*walls, *([Box("cabinet", (0, 2.72), (1.0, 1.2, 0.04))] if front else []))

    assert ask("Is the cabinet open?", paint(cabinet(False), pitch=10)).content == "yes"
    assert ask("Is the cabinet open?", paint(cabinet(True), pitch=10)).content == "no"


def test_answer_one_takes_the_view_that_tells() -> None:
    blind = paint(room(Box("couch", (0, 3.0), (1.8, 0.8, 0.8))))

    assert ask_all("What color is the lamp?", blind, paint(BEDROOM)) == (1, "The lamp is yellow.")


def test_answer_one_does_not_add_up_views_of_one_room() -> None:
    chairs = [Box("chair", (x, 3.2), (0.5, 0.8, 0.5)) for x in (-0.9, 0.0, 0.9)]
    few, many = paint(room(chairs[0])), paint(room(*chairs))

    assert ask_all("How many chairs are there?", few, many, few) == (1, "There are three chairs.")


def test_answer_one_adds_up_views_of_different_rooms() -> None:
    chair = Box("chair", (1.2, 3.2), (0.5, 0.8, 0.5))
    kitchen = paint(
        room(chair, Box("stove", (-0.8, 3.5), (0.6, 0.9, 0.6)), Box("refrigerator", (0.1, 4), (0.6, 1.8, 0.6)))
    )
    bedroom = paint(room(chair, Box("bed", (-0.7, 3.5), (1.4, 0.5, 2.0))))

    assert ask_all("How many chairs are there?", kitchen, bedroom)[1] == "There are two chairs."
    assert ask_all("How many chairs are there in the kitchen?", kitchen, bedroom)[1] == "There is one chair."


def test_answer_one_compares_sizes_seen_in_different_views() -> None:
    wardrobe = paint(room(Box("wardrobe", (0, 3.5), (1.2, 1.9, 0.6))))
    stool = paint(room(Box("stool", (0, 3.0), (0.4, 0.45, 0.4))))

    assert ask_all("Which is taller, the stool or the wardrobe?", stool, wardrobe) == (1, "The wardrobe.")


def test_answer_one_grounds_the_described_thing_where_it_shows_best() -> None:
    near_door = Box("chair", (0.2, 3.2), (0.5, 0.8, 0.5), color="red")
    door = Box("door", (0.9, 4.9), (0.9, 2.0, 0.1), color="brown")
    alone = paint(room(Box("chair", (0, 3.0), (0.5, 0.8, 0.5), color="blue")))
    beside = paint(room(near_door, door))
    at_edge = paint(room(near_door, door), yaw=-22.0)

    assert ask_all("the red chair", alone, at_edge, beside)[0] == 2
    assert ask_all("the chair nearest the door", alone, beside)[0] == 1


def test_answer_many_looks_at_the_main_thing_only() -> None:
    red = Box("chair", (0, 2.6), (0.5, 0.8, 0.5), color="red")
    blue_aside = Box("chair", (1.5, 3.8), (0.5, 0.8, 0.5), color="blue")
    images = [
        paint(room(red, blue_aside)),
        paint(room(Box("chair", (0, 2.6), (0.5, 0.8, 0.5), color="blue"))),
        paint(room()),
    ]
    views = [perceive(image) for image in images]

    assert answer_many(parse_question("all the red chairs", VOCABULARY), views) == [True, False, False]
    assert answer_many(parse_question("the blue chairs", VOCABULARY), views) == [False, True, False]
    assert answer_many(parse_question("the chairs", VOCABULARY), views) == [True, True, False]
    assert answer_many(parse_question("the unicorn", VOCABULARY), views) == [False, False, False]


NAMES = (
    "chair",
    "table",
    "lamp",
    "door",
    "cabinet",
    "box",
    "bed",
    "ball",
    "picture",
    "wall",
    "floor",
    "stove",
    "laptop",
)
QUESTIONS = (
    "What color is the {a} next to the {b}?",
    "How many {a}s are on the {b}?",
    "Where is the red {a}?",
    "What is behind the {a}?",
    "What is between the {a} and the {b}?",
    "Is there more than one {a} under the {b}?",
    "Is the {a} open?",
    "Is the {a} empty?",
    "Is the {a} blue?",
    "Is the {a} in the {b}?",
    "Is the {a} on or off?",
    "Which is closer to the {b}, the {a} or the lamp?",
    "Which is taller, the {a} or the {b}?",
    "Which {a} is farthest from the {b}?",
    "What is the smallest {a}?",
    "Is the {a} left or right of the {b}?",
    "I stand at the {a} and look at the {b}. Is the door to my left or right?",
    "Are the {a} and the {b} in the same room?",
    "Which room is the {a} in?",
    "What is the {a} made of?",
    "What can I sit on near the {a}?",
    "the large {a} in front of the {b}, in the kitchen",
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 100_000),
    question=st.sampled_from(QUESTIONS),
    a=st.sampled_from(NAMES),
    b=st.sampled_from(NAMES),
)
def test_any_question_about_any_clutter_gets_an_answer(seed: int, question: str, a: str, b: str) -> None:
    rng = np.random.default_rng(seed)
    images = []
    for _ in range(2):
        clutter = [
            Box(
                str(rng.choice(NAMES)),
                (float(rng.uniform(-2, 2)), float(rng.uniform(1.5, 4.5))),
                (float(rng.uniform(0.1, 1.5)), float(rng.uniform(0.05, 1.5)), float(rng.uniform(0.1, 1.0))),
                foot=float(rng.choice([0.0, 0.5])),
                color=str(rng.choice(list(RGB))),
            )
            for _ in range(int(rng.integers(0, 12)))
        ]
        images.append(paint(room(*clutter), pitch=float(rng.uniform(-10, 60)), yaw=float(rng.uniform(-30, 30))))
    query = parse_question(question.format(a=a, b=b), VOCABULARY)
    views = [perceive(image) for image in images]

    index, text = answer_one(query, views)
    answer = answer_view(query, views[0])

    assert index in (0, 1)
    assert text
    assert certainty_of(answer.text) == answer.certainty
    assert len(answer_many(query, views)) == 2
