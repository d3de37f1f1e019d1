"""Reading questions: kinds, things, colours, rooms and relations, in sentences the rules were not written from."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.models.symbolic.parse_question import parse_question
from pipeline.models.symbolic.phrases import Phrase, Query
from pipeline.models.symbolic.uses import purpose_of, useful_names
from pipeline.models.symbolic.words import singular, tokens
from pipeline.scene.procedural.vocabulary import VOCABULARY


def read(question: str) -> Query:
    return parse_question(question, VOCABULARY)


def shown(phrase: Phrase) -> str:
    """A phrase as "color noun @room (relation other)", short enough to compare."""
    parts = [*phrase.colors, *phrase.sizes, phrase.state, phrase.extreme, phrase.words or "?"]
    parts += [f"@{phrase.room}"] if phrase.room else []
    for link in phrase.links:
        other = f" & {shown(link.other)}" if link.other else ""
        parts.append(f"({link.relation} {shown(link.anchor)}{other})")
    return " ".join(part for part in parts if part)


@pytest.mark.parametrize(
    ("question", "kind", "target"),
    [
        ("What colour is the chair beside the window?", "color", "chair (next to window)"),
        ("How many cushions lie on the sofa in the lounge?", "count", "cushions @living room (on sofa)"),
        ("What is the number of stools?", "count", "stools"),
        ("Where did I leave my backpack?", "where", "backpack"),
        ("Have you seen the yellow hat?", "where", "yellow hat"),
        ("What is underneath the desk?", "identify", "? (under desk)"),
        ("What is the red object on top of the fridge?", "identify", "red ? (on fridge)"),
        ("Which thing stands between the bed and the wardrobe?", "identify", "? (between bed & wardrobe)"),
        ("Is there a plant on the windowsill?", "exists", "plant (on windowsill)"),
        ("Is the lamp on?", "check", "on lamp"),
        ("Is the chair next to the desk blue?", "check", "blue chair (next to desk)"),
        ("Is the mirror above the sink?", "check", "mirror (above sink)"),
        ("Is the door open or closed?", "state", "door"),
        ("Would you say the bowl is red or green?", "color", "red green bowl"),
        ("Which room is the toaster in?", "room", "toaster"),
        ("What is the table made of?", "material", "table"),
        ("What is a kettle used for?", "purpose", "kettle"),
        ("Which bed is closest to the window?", "which", "bed (nearest window)"),
        ("What is the tallest bookcase?", "which", "tall bookcase"),
        ("this is a brown stool. it is in front of the piano.", "describe", "brown stool (in front of piano)"),
        ("the lamp on the table is next to the bed", "describe", "lamp (on table) (next to bed)"),
        ("the mug on the table that is under the shelf", "describe", "mug (on table (under shelf))"),
        ("the bench is between two pianos. the bench is red.", "describe", "red bench (between pianos)"),
        ("Find the big grey box behind the open door", "describe", "gray large box (behind open door)"),
        ("I'm looking for the towel in the bathroom", "describe", "towel @bathroom"),
        ("Why is the sky blue?", "unknown", "blue sky"),
    ],
)
def test_parse_question_finds_kind_and_target(question: str, kind: str, target: str) -> None:
    query = read(question)

    assert query.kind == kind
    assert shown(query.target) == target


@pytest.mark.parametrize(
    ("question", "options", "measure", "reference"),
    [
        ("Which is closer to the door, the sofa or the tv?", ["sofa", "tv"], "nearest", "door"),
        ("Is the red chair or the bed farther from the tv?", ["red chair", "bed (farthest tv)"], "farthest", "tv"),
        ("Which is taller: the lamp or the dresser?", ["tall lamp", "dresser"], "tall", None),
    ],
)  # fmt: skip
def test_parse_question_finds_what_is_compared(
    question: str, options: list[str], measure: str, reference: str | None
) -> None:
    query = read(question)

    assert query.kind == "compare"
    assert [shown(option) for option in query.options] == options
    assert query.measure == measure
    assert (shown(query.reference) if query.reference else None) == reference


@pytest.mark.parametrize(
    ("question", "placed", "by", "faced"),
    [
        ("Is the lamp to the left or to the right of the bed?", "lamp", "bed", None),
        ("Which side of the couch is the plant on?", "plant", "couch", None),
        ("When you face the sink, is the towel on its left or on its right?", "towel", "sink", None),
        ("I sit at the desk and look at the door. Is the window to my left or right?", "window", "desk", "door"),
    ],
)
def test_parse_question_finds_what_is_placed_left_or_right(
    question: str, placed: str, by: str, faced: str | None
) -> None:
    query = read(question)

    assert query.kind == "side"
    assert query.target.words == placed
    assert query.reference is not None
    assert query.reference.words == by
    assert [option.words for option in query.options] == ([faced] if faced else [])


@pytest.mark.parametrize(
    ("question", "measure", "useful"),
    [
        ("Where can I wash my hands?", "where", "sink"),
        ("I am tired. What could I lie down on?", "", "bed"),
        ("Is there somewhere to sit in the kitchen?", "can", "chair"),
        ("Can I print something here?", "can", "printer"),
        ("It is too dark in here, what should I turn on?", "", "lamp"),
        ("Which object would I use to hang up my coat?", "", "coat rack"),
    ],
)
def test_parse_question_of_a_purpose_asks_for_what_serves_it(question: str, measure: str, useful: str) -> None:
    query = read(question)

    assert query.kind == "use"
    assert query.measure == measure
    assert useful in useful_names(query.words)


def test_parse_question_names_unknown_things_without_meaning() -> None:
    target = read("Is there a giraffe on the sofa?").target

    assert target.words == "giraffe"
    assert not target.named
    assert target.links[0].anchor.exact == {"couch"}


def test_nouns_prefer_the_name_itself_and_fall_back_on_kinds() -> None:
    chair = read("Where is the chair?").target
    seat = parse_question("Where is the chair?", ("armchair", "bed")).target

    assert chair.exact == {"chair"}
    assert "armchair" in chair.kinds
    assert seat.exact == frozenset()
    assert seat.kinds == {"armchair"}


def test_rooms_do_not_hide_the_names_of_furniture() -> None:
    assert read("Where is the kitchen counter?").target.exact == {"kitchen counter"}
    assert read("Where is the counter in the kitchen?").target.room == "kitchen"


@pytest.mark.parametrize(
    ("plural", "one"),
    [
        ("tvs", "tv"),
        ("shelves", "shelf"),
        ("boxes", "box"),
        ("couches", "couch"),
        ("dishes", "dish"),
        ("glass", "glass"),
    ],
)
def test_singular(plural: str, one: str) -> None:
    assert singular(plural) == one


@given(st.text(max_size=200))
def test_parse_question_reads_any_text(text: str) -> None:
    query = read(text)

    assert query.kind
    assert tokens(text) == tokens(text)


def test_useful_names_take_the_more_particular_purpose() -> None:
    assert useful_names(("dry", "my", "hair"))[0] == "hair dryer"
    assert useful_names(("dry", "my", "hands"))[0] == "towel"
    assert useful_names(("consider", "this")) == ()


def test_purpose_of_names_what_a_thing_is_first_for() -> None:
    assert purpose_of("bed") == "sleeping"
    assert purpose_of("no such thing") == ""
