from __future__ import annotations

import asyncio

import numpy as np
import pytest

from pipeline.models.messages import ImagePart
from pipeline.query.judge import Choice, Design, JudgeConfig, Shown, answer_views, choose_views, is_definite
from pipeline.query.savings import Saved, Savings
from schemas.calls import CallRow
from schemas.questions import Question
from tests.query.tiny import Scripted, caller_of

QUESTION = Question("q", "tiny", "eqa", "What is on the table?")


def _choose(
    client: Scripted, groups: list[list[str | None]], *, save: bool = True
) -> tuple[list[Choice], list[CallRow]]:
    """Choose by text; the pictures differ."""
    calls: list[CallRow] = []
    shown = {number: [Shown(_image(7), text) for text in group] for number, group in enumerate(groups)}
    savings = Savings() if save else None
    choices = asyncio.run(choose_views(QUESTION, shown, caller_of(client), calls, savings=savings))
    return list(choices.values()), calls


def _image(shade: int) -> ImagePart:
    return ImagePart(np.full((2, 2, 3), shade, np.uint8))


def test_every_view_is_answered_alone_in_order() -> None:
    client = Scripted({"view_answer": lambda request: f"shade {request.images()[0].color[0, 0, 0]}"})
    calls: list[CallRow] = []
    images = [_image(shade) for shade in (7, 5, 9)]
    answers = asyncio.run(answer_views(QUESTION, images, ["a", "b", "c"], caller_of(client), calls))
    assert answers == ["shade 7", "shade 5", "shade 9"]
    assert [row.subject for row in calls] == ["a", "b", "c"]
    assert all(len(request.images()) == 1 for request in client.requests)
    assert all(request.variables["question"] == QUESTION.question for request in client.requests)


def test_blank_view_answer_is_none() -> None:
    client = Scripted({"view_answer": "  "})
    calls: list[CallRow] = []
    assert asyncio.run(answer_views(QUESTION, [_image(1)], ["a"], caller_of(client), calls)) == [None]
    assert [row.outcome for row in calls] == ["unparsed", "unparsed"]


def test_choice_is_made_from_texts_alone_for_each_cluster() -> None:
    client = Scripted({"choice": lambda request: "2" if "cup" in request.variables["candidates"][0] else "0"})
    choices, calls = _choose(client, [["a cup", "nothing", "a red cup"], ["a vase", "a blue vase"]])
    assert choices == [Choice(2), Choice(0)]
    assert [row.subject for row in calls] == ["cluster 0", "cluster 1"]
    assert not any(request.images() for request in client.requests)


def test_equal_answers_keep_the_initial_view_and_ask_nothing() -> None:
    client = Scripted({})
    choices, _ = _choose(client, [["a cup"] * 5, ["only one"]])
    assert choices == [Choice(0), Choice(0)]
    assert not client.requests


def test_equal_answers_among_others_are_all_shown() -> None:
    client = Scripted({"choice": "2"})
    choices, _ = _choose(client, [["a cup", "a cup", "a vase"]])
    assert client.requests[0].variables["candidates"] == ["a cup", "a cup", "a vase"]
    assert choices == [Choice(2)]


def test_candidates_without_an_answer_take_no_part() -> None:
    client = Scripted({"choice": "1"})
    choices, _ = _choose(client, [[None, "a cup", None, "a red cup"], [None, "same", "same"]])
    assert choices == [Choice(3), Choice(1)]
    assert client.requests[0].variables["candidates"] == ["a cup", "a red cup"]
    assert client.count("choice") == 1


def test_a_cluster_without_any_answer_has_no_choice_and_a_reason() -> None:
    choices, _ = _choose(Scripted({}), [[None, None]])
    assert choices[0].candidate is None
    assert "cluster 0" in choices[0].reason


def test_an_unreadable_choice_is_none_with_a_reason() -> None:
    client = Scripted({"choice": "the second one, I think, or the third"})
    choices, calls = _choose(client, [["a", "b"]])
    assert choices[0].candidate is None
    assert "could not be read" in choices[0].reason
    assert len(calls) == 2


def _by_sight(
    client: Scripted, groups: list[list[Shown | None]], design: Design, *, save: bool = True
) -> tuple[list[Choice], Savings]:
    savings = Savings()
    choices = asyncio.run(
        choose_views(
            QUESTION,
            dict(enumerate(groups)),
            caller_of(client),
            [],
            design=design,
            savings=savings if save else None,
        )
    )
    return list(choices.values()), savings


FIRST, SECOND = _image(1), _image(2)


class TestDesigns:
    def test_choice_by_images_shows_the_views_and_no_text(self) -> None:
        client = Scripted({"choice": "1"})
        choices, _ = _by_sight(client, [[Shown(FIRST, "a cup"), None, Shown(SECOND, None)]], "image")
        assert choices == [Choice(2)]
        assert list(client.requests[0].images()) == [FIRST, SECOND]
        assert set(client.requests[0].variables) == {"question", "design"}

    def test_choice_by_both_shows_each_answer_under_the_number_of_its_image(self) -> None:
        client = Scripted({"choice": "1"})
        group: list[Shown | None] = [Shown(FIRST, None), Shown(SECOND, "a cup"), Shown(FIRST, "a vase")]
        choices, _ = _by_sight(client, [group], "image_text")
        assert choices == [Choice(2)]
        assert list(client.requests[0].images()) == [SECOND, FIRST]
        assert client.requests[0].variables["candidates"] == ["a cup", "a vase"]

    @pytest.mark.parametrize("design", ["image", "image_text"])
    def test_equal_pictures_are_shown_once_and_alone_need_no_choice(self, design: Design) -> None:
        client = Scripted({"choice": "1"})
        same, other = Shown(FIRST, "a cup"), Shown(SECOND, "a cup")
        choices, savings = _by_sight(client, [[same, same], [same, other, same]], design)
        assert choices == [Choice(0), Choice(1)]
        assert [list(request.images()) for request in client.requests] == [[FIRST, SECOND]]
        assert savings.entries() == (Saved("choice", "equal pictures", 1),)

    @pytest.mark.parametrize("design", ["text", "image", "image_text"])
    def test_without_savings_every_cluster_is_asked_about(self, design: Design) -> None:
        client = Scripted({"choice": "0"})
        same = Shown(FIRST, "a cup")
        choices, _ = _by_sight(client, [[same], [same, same]], design, save=False)
        assert choices == [Choice(0), Choice(0)]
        assert client.count("choice") == 2

    def test_choice_by_images_has_nothing_to_stop_by(self) -> None:
        with pytest.raises(ValueError, match="stop_when_definite"):
            JudgeConfig(design="image", stop_when_definite=True)


def test_a_spared_choice_is_counted() -> None:
    savings, calls = Savings(), list[CallRow]()
    shown = {3: [Shown(FIRST, "a cup"), Shown(SECOND, "a cup")], 5: [Shown(FIRST, "a cup"), Shown(SECOND, "a vase")]}
    asyncio.run(choose_views(QUESTION, shown, caller_of(Scripted({})), calls, savings=savings))
    assert savings.entries() == (Saved("choice", "equal answers", 1),)
    assert [row.subject for row in calls] == ["cluster 5"]


@pytest.mark.parametrize(
    ("text", "definite"),
    [
        ("The cup is red.", True),
        ("No, it is closed.", True),
        ("It looks like the cup is red.", False),
        ("I cannot tell from this view.", False),
        ("I do not see a cup.", False),
        ("I'm sorry, I can't help with that.", False),
        ("这张图看不出来。", False),
        ("", False),
        ("4", False),
    ],
)
def test_is_definite_reads_how_sure_an_answer_is(text: str, definite: bool) -> None:
    assert is_definite(text) is definite
