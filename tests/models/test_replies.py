"""Reply parsers against a corpus of replies as models really write them, and against their laws."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.models import replies
from pipeline.models.replies import ImageAnswer

VOCABULARY = ("coat rack", "sofa", "TV", "chair, swivel", "1. shelf")

REFUSALS = [
    "",
    " \n\t ",
    "I'm sorry, but I can't assist with that.",
    "无法回答这个问题。",
    "```\n```",
    "<think>hm, 2?",
    "null",
    "{}",
    "[]",
]
"""Nothing can be read from these, whatever was asked."""

INDEX = {
    "2": 2,
    " 2\n": 2,
    "2.": 2,
    "**2**": 2,
    "`1`": 1,
    '"1"': 1,
    "(1)": 1,
    "[0]": 0,
    "- 2": 2,
    "Index: 2": 2,
    "index 1": 1,
    "The best answer is 2": 2,
    "**Final answer:** 1": 1,
    "```\n2\n```": 2,
    '```json\n{"index": 1}\n```': 1,
    "<think>0 or 1? 1.</think>\n0": 0,
    "Sentence 1 names the colour, the others do not.\n\n1": 1,
    "1\n\nIt names the colour.": 1,
    "1: The sofa is red.": 1,
    "2\\n": 2,
    "3": None,
    "-1": None,
    "- 1 is the best": None,
    "1.5": None,
    "1 or 2": None,
    "1\n2": None,
    "0: a\n1: b\n2: c": None,
    "2 chairs": None,
    "I see 2 chairs.": None,
    "the second one": None,
    "zwei": None,
    "２": None,
    "十": None,
    "true": None,
    '{"index": true}': None,
    '{"index": "1"}': None,
    '{"index": 7}': None,
    '{"index": 1, "index": 2}': None,
    "99999999999999999999": None,
    "1. The sofa is red.": None,
}

IMAGE_ANSWER = {
    "Image 0\nOn the desk.": ImageAnswer(0, "On the desk."),
    "Image 1 \\n On the desk.": ImageAnswer(1, "On the desk."),
    "image 1:\n\nOn the desk.\nBeside the lamp.": ImageAnswer(1, "On the desk.\nBeside the lamp."),
    "**Image 1**\n**On the desk.**": ImageAnswer(1, "On the desk."),
    "[Image 1]\nLà-bas.": ImageAnswer(1, "Là-bas."),
    "Image 0: On the desk.": ImageAnswer(0, "On the desk."),
    "**Image 0:** On the desk.": ImageAnswer(0, "On the desk."),
    "Image 0 - On the desk.": ImageAnswer(0, "On the desk."),
    "Sure! Here it is:\nImage 1\n青い椅子です。": ImageAnswer(1, "青い椅子です。"),
    "Image 1\nIt is beside the chair of Image 0.": ImageAnswer(1, "It is beside the chair of Image 0."),
    "<think>\nImage 0\nno\n</think>\nImage 1\nyes": ImageAnswer(1, "yes"),
    '```json\n{"image": 1, "answer": "red"}\n```': ImageAnswer(1, "red"),
    "Image 2\nOn the desk.": None,
    "Image 1": None,
    "Image 1\n\n": None,
    "Image 0 shows the lamp on the desk.": None,
    "Image -1\nx": None,
    "Image one\nx": None,
    "Image 0\nred\nImage 1\nblue": None,
    "Image 0: red\nImage 1: blue": None,
    "0\nOn the desk.": None,
    "On the desk.": None,
    "Bild 0\nAuf dem Tisch.": None,
    '{"image": "1", "answer": "red"}': None,
    '{"image": 1}': None,
    '{"image": 1, "answer": " "}': None,
}

YES_NO = {
    "Image 0: Yes\nImage 1: No": (True, False),
    "image 1: NO.\nimage 0: yes.": (True, False),
    "**Image 0:** Yes\n**Image 1:** No": (True, False),
    "1. Image 0: No\n2. Image 1: Yes": (False, True),
    "- Image 0: No, only a stool.\n- Image 1: Yes (behind the desk)": (False, True),
    "Image 0 - No\nImage 1 - No": (False, False),
    "Here you go.\n\nImage 0: Yes\nImage 1: Yes\n\nTell me if you need more.": (True, True),
    '{"Image 0": "Yes", "Image 1": "No"}': (True, False),
    "Image 0: No\\nImage 1: Yes": (False, True),
    "Image 1: Yes\nImage 2: No": None,
    "Image 0: Yes": None,
    "Image 0: Yes\nImage 1: No\nImage 2: No": None,
    "Image 0: Yes\nImage 0: Yes\nImage 1: No": None,
    "Image 0: Yes\nImage 0: No": None,
    "Image 0: Yes\nImage 1: Maybe": None,
    "Image 0: Yes/No\nImage 1: No": None,
    "Image 0: Yes\nImage 1: No, or rather yes": None,
    "Image 0: Not there\nImage 1: No": None,
    "Image 0: Ja\nImage 1: Nein": None,
    "Yes\nNo": None,
    '{"Image 0": true, "Image 1": false}': None,
    "Images 0 and 1: Yes": None,
}

MARK = {
    "5": 5,
    "4.": 4,
    "4/5": 4,
    "Your mark: 4": 4,
    "your mark is 2.": 2,
    "**Your mark:** 3": 3,
    "Your mark: **3**": 3,
    "Your mark: 4/5": 4,
    "Your mark: 4 out of 5": 4,
    "The colour differs.\nYour mark: 2": 2,
    "Your mark: 5\nIt says the same.": 5,
    "Your mark: 5. Indeed, your mark: 5": 5,
    "Your mark: 0": None,
    "Your mark: 6": None,
    "Your mark: 10": None,
    "Your mark: 3.5": None,
    "Your mark: 4/10": None,
    "Your mark: -1": None,
    "Your mark: 1 ... Your mark: 5": None,
    "Your mark: five": None,
    "6": None,
    "I would give it 4": None,
    "Note: 4": None,
}

EVIDENCE = {
    "sofa\ncoat rack": ("sofa", "coat rack"),
    "1. Sofa\n2. tv\n": ("sofa", "TV"),
    "- **sofa**\n- `TV`.": ("sofa", "TV"),
    "sofa, tv": ("sofa", "TV"),
    "chair, swivel": ("chair, swivel",),
    "chair, swivel\nsofa": ("chair, swivel", "sofa"),
    "1. shelf": ("1. shelf",),
    "2. 1. shelf": ("1. shelf",),
    "sofa\nsofa\nTV": ("sofa", "TV"),
    "sofa\ncoat rack\nTV": ("sofa", "coat rack"),
    "The most useful ones are:\nsofa": ("sofa",),
    "couch\nsofa": ("sofa",),
    '```json\n["sofa", "TV"]\n```': ("sofa", "TV"),
    '{"categories": ["TV"]}': ("TV",),
    "none": (),
    "None.": (),
    '"none"': (),
    "None of the categories help.": None,
    "couch": None,
    "I would look at the sofa.": None,
    "sofa or TV": None,
    "沙发": None,
}


@pytest.mark.parametrize("reply", [*INDEX, *REFUSALS])
def test_parse_index_corpus(reply: str) -> None:
    assert replies.parse_index(reply, 3) == INDEX.get(reply)


@pytest.mark.parametrize("reply", [*IMAGE_ANSWER, *REFUSALS])
def test_parse_image_answer_corpus(reply: str) -> None:
    assert replies.parse_image_answer(reply, 2) == IMAGE_ANSWER.get(reply)


@pytest.mark.parametrize("reply", [*YES_NO, *REFUSALS])
def test_parse_yes_no_corpus(reply: str) -> None:
    assert replies.parse_yes_no(reply, 2) == YES_NO.get(reply)


@pytest.mark.parametrize("reply", [*MARK, *REFUSALS])
def test_parse_mark_corpus(reply: str) -> None:
    assert replies.parse_mark(reply) == MARK.get(reply)


@pytest.mark.parametrize("reply", [*EVIDENCE, *REFUSALS])
def test_parse_evidence_corpus(reply: str) -> None:
    assert replies.parse_evidence(reply, VOCABULARY, 2) == EVIDENCE.get(reply)


def test_parse_text_drops_wrappings_only() -> None:
    assert replies.parse_text("<think>x</think>\n I cannot tell from this view. ") == "I cannot tell from this view."
    assert replies.parse_text("```\nred\n```") == "red"
    assert replies.parse_text("a\\nb {\n") == "a\\nb {"
    assert [replies.parse_text(text) for text in ("", " \n", "<think>so", "<think>so</think>")] == [None] * 4


@given(st.integers(1, 40).flatmap(lambda n: st.tuples(st.just(n), st.lists(st.booleans(), min_size=n, max_size=n))))
def test_parse_yes_no_reads_back_what_the_prompt_asks_for(case: tuple[int, list[bool]]) -> None:
    count, verdicts = case
    text = "\n".join(f"Image {i}: {'Yes' if yes else 'No'}" for i, yes in enumerate(verdicts))
    assert replies.parse_yes_no(text, count) == tuple(verdicts)
    assert replies.parse_yes_no(text, count + 1) is None
    assert count == 1 or replies.parse_yes_no(text, count - 1) is None


@given(st.integers(0, 60), st.integers(0, 60))
def test_parse_index_accepts_exactly_the_range(index: int, count: int) -> None:
    expected = index if index < count else None
    assert replies.parse_index(str(index), count) == expected
    assert replies.parse_index(json.dumps({"index": index}), count) == expected
    assert replies.parse_index(f"Some words first.\n{index}", count) == expected


@given(st.integers(0, 9), st.text(st.characters(exclude_categories=["Cs", "Cc", "Zl", "Zp"], exclude_characters="*\\")))
def test_parse_image_answer_keeps_the_answer(index: int, answer: str) -> None:
    expected = ImageAnswer(index, answer.strip()) if answer.strip() else None
    parsed = replies.parse_image_answer(f"Image {index}\n{answer}", 10)
    assert parsed == expected or answer.lower().lstrip(" \"'`([{#_-").startswith("image")


@given(st.lists(st.sampled_from(VOCABULARY), unique=True, min_size=1), st.integers(1, 6))
def test_parse_evidence_keeps_order_and_truncates(names: list[str], k: int) -> None:
    assert replies.parse_evidence("\n".join(names), VOCABULARY, k) == tuple(names[:k])
    assert replies.parse_evidence(json.dumps(names), VOCABULARY, k) == tuple(names[:k])


@given(st.text(max_size=200), st.integers(0, 5))
def test_parsers_never_raise_and_stay_in_range(text: str, count: int) -> None:
    index = replies.parse_index(text, count)
    assert index is None or 0 <= index < count
    answer = replies.parse_image_answer(text, count)
    assert answer is None or (0 <= answer.index < count and answer.answer)
    verdicts = replies.parse_yes_no(text, count)
    assert verdicts is None or len(verdicts) == count
    assert replies.parse_mark(text) in (None, 1, 2, 3, 4, 5)
    evidence = replies.parse_evidence(text, VOCABULARY, 2)
    assert evidence is None or (len(evidence) <= 2 and set(evidence) <= set(VOCABULARY))


@pytest.mark.parametrize("reply", ["[" * 100_000, '{"a":' * 50_000, "Image " * 50_000, "*" * 200_000, "0" * 100_000])
def test_parsers_hostile_lengths_are_unreadable_and_quick(reply: str) -> None:
    assert replies.parse_index(reply, 3) is None
    assert replies.parse_image_answer(reply, 3) is None
    assert replies.parse_yes_no(reply, 3) is None
    assert replies.parse_mark(reply) is None
    assert replies.parse_evidence(reply, VOCABULARY, 2) is None
