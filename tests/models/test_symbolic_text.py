"""The stages that only read: evidence, choice, verification and the judge."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.models.symbolic.certainty import CANNOT_TELL, Certainty, certainty_of
from pipeline.models.symbolic.choose import choose, verify
from pipeline.models.symbolic.evidence import rank_evidence
from pipeline.models.symbolic.judge import judge

PRESENT = ["armchair", "bed", "bookshelf", "chair", "couch", "desk", "door", "floor", "lamp", "picture", "refrigerator",
           "sink", "stove", "table", "trash can", "wall", "window"]  # fmt: skip


@pytest.mark.parametrize(
    ("question", "k", "names"),
    [
        ("What color is the chair next to the bed?", 3, ["chair", "bed"]),
        ("What is under the table by the window?", 3, ["table", "window"]),
        ("Where is the sofa?", 3, ["couch"]),
        ("Which is closer to the door, the couch or the table?", 3, ["couch", "table", "door"]),
        ("Where can I take a nap?", 2, ["bed", "couch"]),
        ("Where can I take a nap?", 1, ["bed"]),
        ("Is there a microwave in the kitchen?", 3, ["refrigerator", "stove"]),
        ("What hangs on the wall?", 2, ["picture", "wall"]),
        ("the lamp on the desk", 1, ["lamp"]),
        ("the unicorn next to the bed", 1, ["none"]),
        ("What is the meaning of life?", 3, ["none"]),
    ],
)
def test_rank_evidence_puts_the_target_first(question: str, k: int, names: list[str]) -> None:
    assert rank_evidence(question, PRESENT, k).split("\n") == names


@given(st.text(max_size=80), st.integers(1, 5))
def test_rank_evidence_names_at_most_k_present_categories(question: str, k: int) -> None:
    lines = rank_evidence(question, PRESENT, k).split("\n")

    assert len(lines) <= k
    assert lines == ["none"] or (set(lines) <= set(PRESENT) and len(set(lines)) == len(lines))


@pytest.mark.parametrize(
    ("text", "certainty"),
    [
        (CANNOT_TELL, Certainty.UNKNOWN),
        ("", Certainty.UNKNOWN),
        ("I'm sorry, the image doesn't show the kitchen.", Certainty.UNKNOWN),
        ("It is not clear from the picture.", Certainty.UNKNOWN),
        ("Unable to determine.", Certainty.UNKNOWN),
        ("No, I do not see a chair.", Certainty.UNSEEN),
        ("It looks like the chair is red.", Certainty.HEDGED),
        ("The chair might be red.", Certainty.HEDGED),
        ("Probably a lamp", Certainty.HEDGED),
        ("The chair is red.", Certainty.DEFINITE),
        ("No, the door is closed.", Certainty.DEFINITE),
        ("Nothing.", Certainty.DEFINITE),
    ],
)
def test_certainty_of(text: str, certainty: Certainty) -> None:
    assert certainty_of(text) == certainty


@pytest.mark.parametrize(
    ("candidates", "index"),
    [
        ([CANNOT_TELL, "It looks like the chair is red.", "The chair is blue."], 2),
        ([CANNOT_TELL, "I do not see a chair.", "Perhaps red."], 2),
        ([CANNOT_TELL, "No, I do not see a chair."], 1),
        ([CANNOT_TELL, CANNOT_TELL], 0),
        (["The chair is blue.", "The chair is red.", "Red."], 1),
        (["A lamp.", "A lamp and a book."], 1),
        (["The chair is red.", "It is red.", "red"], 0),
    ],
)
def test_choose_prefers_sure_then_agreed_then_specific_then_first(candidates: list[str], index: int) -> None:
    assert choose("What color is the chair?", candidates) == index


@pytest.mark.parametrize(
    ("initial", "final", "kept"),
    [
        (CANNOT_TELL, "A lamp.", 1),
        ("A lamp.", CANNOT_TELL, 0),
        ("Perhaps a lamp.", "A lamp.", 1),
        ("A lamp.", "A book and a cup.", 0),
        (CANNOT_TELL, CANNOT_TELL, 0),
    ],
)
def test_verify_keeps_the_first_unless_only_the_second_answers(initial: str, final: str, kept: int) -> None:
    assert verify("What is on the table?", [initial, final]) == kept


@pytest.mark.parametrize(
    ("question", "reference", "prediction", "mark"),
    [
        ("What color is the chair?", "Red", "The chair is red.", 5),
        ("What color is the chair?", "grey", "It looks like the chair is gray.", 5),
        ("What color is the chair?", "Red", "The chair is blue.", 1),
        ("What color is the chair?", "Red and white", "Red", 3),
        ("What color is the chair?", "Red", "Red and white", 4),
        ("Is the door brown or blue?", "Brown", "The door is brown.", 5),
        ("How many chairs are there?", "3", "There are three chairs.", 5),
        ("How many chairs are there?", "Three", "There are 2 chairs.", 1),
        ("How many chairs are there?", "Three", "Several.", 1),
        ("Is there a lamp?", "Yes", "Yes, there is a lamp on the desk.", 5),
        ("Is there a lamp?", "No", "No, I do not see a lamp.", 5),
        ("Is there a lamp?", "Yes", "No.", 1),
        ("Is there a lamp?", "Yes, on the desk", "Yes.", 4),
        ("Is the door open?", "Yes", "The door is open.", 5),
        ("Is the door open?", "No", "It is closed.", 5),
        ("Is the door open or closed?", "Open", "It looks like the door is open.", 5),
        ("Is the door open or closed?", "Open", "The door is closed.", 1),
        ("Is the lamp on or off?", "On", "The lamp is on.", 5),
        ("What is on the table?", "A laptop", "There is a laptop on the table.", 5),
        ("What is on the table?", "A laptop", "There is a laptop and a cup on the table.", 4),
        ("What is on the table?", "A laptop and a cup", "A laptop", 3),
        ("What is on the table?", "A laptop, a cup and a book", "A laptop", 2),
        ("What is on the table?", "A laptop", "A vase", 1),
        ("What is in the corner?", "The sofa", "A couch.", 5),
        ("Where is the lamp?", "On the desk", "The lamp is on the desk.", 5),
        ("Where is the lamp?", "On the black desk", "The lamp is on the desk.", 4),
        ("Where is the lamp?", "Beside the bed", "The lamp is next to the bed.", 5),
        ("Where is the lamp?", "On the desk", "The lamp is under the desk.", 2),
        ("Where is the bathroom counter?", "In the bathroom", "The counter is next to the sink in the bathroom.", 4),
        ("Which is larger, the blue couch or the stool?", "The blue couch", "The couch.", 5),
        ("Which is larger, the blue couch or the stool?", "The blue couch", "The stool.", 1),
        ("Is the lamp left or right of the bed?", "On the left", "The lamp is on the left of the bed.", 5),
        ("Is the lamp left or right of the bed?", "On the left", "The lamp is on the right of the bed.", 1),
        ("What is on the table?", "A laptop", CANNOT_TELL, 1),
        ("What is on the table?", "It cannot be determined.", CANNOT_TELL, 5),
        ("What is on the table?", "A laptop", "", 1),
    ],
)
def test_judge_marks(question: str, reference: str, prediction: str, mark: int) -> None:
    assert judge(question, reference, prediction) == mark


def test_judge_takes_the_best_of_the_accepted_answers() -> None:
    assert judge("Where is the lamp?", "In the bedroom", "On the desk.", ["On the desk", "By the window"]) == 5


@given(st.text(min_size=1, max_size=60).filter(lambda text: text.strip() and text.strip(" .")))
def test_judge_gives_the_reference_itself_full_marks(text: str) -> None:
    assert judge("What is it?", text, text) == 5


@given(st.text(max_size=60), st.text(max_size=60), st.text(max_size=60))
def test_judge_always_gives_a_mark(question: str, reference: str, prediction: str) -> None:
    assert judge(question, reference, prediction) in (1, 2, 3, 4, 5)
