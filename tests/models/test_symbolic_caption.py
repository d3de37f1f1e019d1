"""The symbolic caption and its choice among views: from what a view shows alone."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from pipeline.models.messages import ImagePart, Message, Request, Stage
from pipeline.models.replies import parse_caption, parse_index
from pipeline.models.symbolic import SymbolicModel
from pipeline.models.symbolic import caption as module
from pipeline.models.symbolic.caption import SHOWS_NOTHING, caption
from pipeline.models.symbolic.perceive import perceive
from schemas.errors import InputError
from tests.models.symbolic_painting import Box, paint, room

CHAIR = Box("chair", (-0.8, 2.5), (0.5, 0.8, 0.5), color="red")
TABLE = Box("table", (0.9, 3.5), (0.9, 0.7, 0.6), color="brown")
BOOK = Box("book", (0.9, 3.4), (0.4, 0.15, 0.3), foot=0.7, color="blue")
QUESTION = "What color is the chair?"


def _reply(stage: Stage, *images: ImagePart, **variables: Any) -> str:
    return asyncio.run(SymbolicModel().complete(Request(stage, (Message("user", images),), variables))).text


def test_caption_names_things_with_colour_side_and_place() -> None:
    text = caption(perceive(paint(room(CHAIR, TABLE, BOOK))))
    assert "On the left is a red chair" in text
    assert "a blue book on the table" in text
    assert "Around it: brown floor, white wall." in text


def test_caption_of_nothing_says_so() -> None:
    assert caption(perceive(paint([]))) == SHOWS_NOTHING


def test_caption_does_not_name_what_is_hidden() -> None:
    screen = Box("cabinet", (0.9, 2.0), (1.6, 2.0, 0.2), color="white")
    assert "book" not in caption(perceive(paint(room(TABLE, BOOK, screen))))


def test_caption_places_the_largest_things_and_lists_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_THINGS", 3)
    boxes = [Box("box", (x, 4.0), (0.3, 0.3, 0.3), color="green") for x in (-1.4, -0.7, 0.0, 0.7, 1.4)]
    text = caption(perceive(paint(room(*boxes))))
    assert text.count("green box") == 3
    assert "Also seen: 2 boxes." in text


def test_caption_stage_needs_no_question_and_is_read_back_whole() -> None:
    text = _reply("caption", paint(room(CHAIR)))
    assert parse_caption(text) == text
    assert text == _reply("caption", paint(room(CHAIR)))
    with pytest.raises(InputError, match="images"):
        _reply("caption")


@pytest.mark.parametrize("place", [0, 1, 2])
def test_choice_by_images_takes_the_view_that_shows_the_thing(place: int) -> None:
    views = [paint(room()), paint(room(TABLE)), paint(room(BOOK))]
    views[place] = paint(room(CHAIR))
    assert parse_index(_reply("choice", *views, question=QUESTION, design="image"), 3) == place


def test_choice_by_images_of_equal_views_is_the_first() -> None:
    view = paint(room(CHAIR))
    assert _reply("choice", view, view, question=QUESTION, design="image") == "0"


def test_choice_by_both_compares_only_the_views_whose_answers_are_surest() -> None:
    views = [paint(room()), paint(room(CHAIR))]
    unsure, sure = "I cannot tell from this view.", "The chair is red."
    for texts, chosen in (((unsure, sure), "1"), ((sure, unsure), "0"), ((sure, sure), "1"), ((unsure, unsure), "1")):
        assert _reply("choice", *views, question=QUESTION, design="image_text", candidates=list(texts)) == chosen
