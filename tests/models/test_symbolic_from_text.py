"""The symbolic model's answers from descriptions and from nothing: rules over sentences of its own form."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from pipeline.models.messages import Message, Request, Stage
from pipeline.models.symbolic import SymbolicModel
from pipeline.models.symbolic.blind import GUESSES, answer_blind
from pipeline.models.symbolic.caption import caption, caption_object
from pipeline.models.symbolic.certainty import Certainty, certainty_of
from pipeline.models.symbolic.facts import Fact, read_facts
from pipeline.models.symbolic.from_text import answer_from_text
from pipeline.models.symbolic.perceive import perceive
from tests.models.symbolic_painting import Box, paint, room

CHAIR = Box("chair", (-0.8, 2.5), (0.5, 0.8, 0.5), color="red")
TABLE = Box("table", (0.9, 3.5), (0.9, 0.7, 0.6), color="brown")
BOOK = Box("book", (0.9, 3.4), (0.4, 0.15, 0.3), foot=0.7, color="blue")
PICTURES = (
    "This is the kitchen. On the left is a white refrigerator next to the stove, close by, closed. In the middle is a "
    "blue and white cup on the dining table. Also seen: 2 bowls and an apple. Around it: white wall, brown floor.",
    "This is the kitchen. On the right is a white refrigerator, far away, closed. There are blue blinds on the wall.",
    "This is the living room. In the middle is what looks like a green couch, open. On the left is a chair. On the "
    "right is a red chair next to the couch.",
)
OBJECTS = (
    "Object 0: There is a red chair. It is next to the table (object 2). Place 1.0, 0.2, 0.4 m, size 0.5, 0.5, 0.9 m.",
    "Object 1: There is a brown chair. Place 4.0, 0.2, 0.4 m, size 0.5, 0.5, 0.9 m.",
    "Object 2: There is a brown table. It is next to the chair (object 0). Place 1.9, 0.2, 0.4 m, size 1.5 m.",
    "Object 3: There is a blue cup, close by. It is on the table (object 2). Place 1.9, 0.2, 0.8 m, size 0.1 m.",
)


def test_facts_hold_what_the_sentences_say() -> None:
    facts = read_facts(PICTURES)
    assert facts[0] == Fact(
        0, "refrigerator", ("white",), (("next to", "stove"),), frozenset({"closed"}), True, "kitchen"
    )
    assert facts[1].colors == ("blue", "white")
    assert [fact.name for fact in facts if fact.note == 0] == ["refrigerator", "cup", "bowl", "bowl", "apple"]
    assert [fact.clear for fact in facts if fact.name == "couch"] == [False]
    assert read_facts(OBJECTS)[3].places == (("on", "table"),)
    assert read_facts(["Nothing of the form.", ""]) == []


def test_facts_read_the_captions_back() -> None:
    view = perceive(paint(room(CHAIR, TABLE, BOOK)))
    found = {fact.name: fact for fact in read_facts([caption(view)])}
    assert found["chair"].colors[0] == "red"
    assert ("on", "table") in found["book"].places
    alone = read_facts([f"Object 0: {caption_object(view, 'book')}"])
    assert [(fact.name, fact.colors[0]) for fact in alone] == [("book", "blue")]
    assert caption_object(view, "owl") == "There is an owl."


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("How many chairs are there?", "There are two chairs."),
        ("What color is the refrigerator?", "The refrigerator is white."),
        ("Where is the cup?", "The cup is on the dining table in the kitchen."),
        ("What is on the dining table?", "There is a cup on the dining table."),
        ("Is there a couch?", "Yes, there is a couch."),
        ("Is there an owl?", "No, I do not see any owl."),
        ("Is there anything on the dining table?", "Yes, there is a thing."),
        ("Is there anything on the refrigerator?", "No, I do not see any such thing."),
        ("Is the refrigerator open or closed?", "The refrigerator is closed."),
        ("Is the couch green?", "Yes."),
        ("Is the refrigerator green?", "No."),
        ("In which room is the couch?", "The couch is in the living room."),
    ],
)
def test_answers_from_pictures(question: str, answer: str) -> None:
    assert answer_from_text(question, PICTURES, of_objects=False) == answer


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("How many chairs are there?", "There are two chairs."),
        ("How many tables are there?", "There is one table."),
        ("What color is the chair next to the table?", "The chair is red."),
        ("Where is the cup?", "The cup is on the table."),
    ],
)
def test_answers_from_objects_count_every_line(question: str, answer: str) -> None:
    assert answer_from_text(question, OBJECTS, of_objects=True) == answer


def test_pictures_are_not_added_up() -> None:
    twice = (PICTURES[2], PICTURES[2])
    assert answer_from_text("How many chairs are there?", twice, of_objects=False) == "There are two chairs."


@pytest.mark.parametrize("question", ["Why is it so?", "Where is the owl?", "What color is the owl?"])
def test_what_no_description_says_cannot_be_told(question: str) -> None:
    assert certainty_of(answer_from_text(question, PICTURES, of_objects=False)) == Certainty.UNKNOWN


@pytest.mark.parametrize(
    ("question", "word"),
    [
        ("How many chairs are there?", "two"),
        ("What can I use to sit down?", "couch"),
        ("In which room is the stove?", "kitchen"),
        ("Is the door open or closed?", "open"),
    ],
)
def test_blind_guesses_fit_the_kind_of_question(question: str, word: str) -> None:
    assert word in answer_blind(question)
    assert certainty_of(answer_blind(question)) == Certainty.DEFINITE


def test_every_guess_is_an_answer() -> None:
    assert all(certainty_of(guess) == Certainty.DEFINITE for guess in GUESSES.values())


def _reply(stage: Stage, **variables: Any) -> str:
    return asyncio.run(SymbolicModel().complete(Request(stage, (Message("user", ()),), variables))).text


def test_the_model_answers_the_stages_of_the_baselines() -> None:
    question = "How many chairs are there?"
    assert (
        _reply("answer_text", question=question, notes=list(OBJECTS[:2]), design="objects") == "There are two chairs."
    )
    assert _reply("answer_text", question=question, notes=list(OBJECTS[:2])) == "There is one chair."
    assert _reply("answer_blind", question=question) == answer_blind(question)
