"""Descriptions: each denotes its object and nothing else, and what makes one unclear."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.scene.objects import SceneObject
from pipeline.scene.questions.names import (
    capital,
    count_word,
    join_names,
    may_be_called,
    plural,
    room_word,
    with_article,
)
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.world import Phrase, World, build_world
from tests.scene.home import ROOMS, build_home


@pytest.fixture(scope="module")
def home() -> World:
    return build_world(build_home(), ROOMS)


def position(world: World, category: str, color: str = "", room: str = "") -> int:
    found = [
        i
        for i, o in enumerate(world.objects)
        if o.category == category and color in ("", o.color) and room in ("", o.room)
    ]
    assert len(found) == 1, found
    return found[0]


def test_every_description_denotes_its_object_alone(home: World) -> None:
    describer = Describer(home)
    count = 0
    for i in home.askable:
        for phrase in describer.all(i):
            assert np.flatnonzero(home.denotes(phrase)).tolist() == [i], phrase.text
            assert np.flatnonzero(home.denotes(phrase, lenient=True)).tolist() == [i], phrase.text
            count += 1
    assert count > 100


def test_every_object_but_like_chairs_around_a_table_can_be_described(home: World) -> None:
    describer = Describer(home)
    silent = {home.objects[i].category for i in home.askable if not describer.all(i)}
    assert silent == {"chair"}


def test_plain_descriptions_come_shortest_first(home: World) -> None:
    plain = Describer(home).plain[position(home, "backpack", "red")]
    assert [p.text for p in plain] == ["red backpack", "backpack in the bedroom", "red backpack in the bedroom"]


def test_a_thing_of_unnamed_color_makes_a_color_unclear() -> None:
    red = SceneObject(0, "box", "red", (0.0, 0.0, 0.1), (0.1, 0.1, 0.1))
    plain = SceneObject(1, "box", "", (1.0, 0.0, 0.1), (0.1, 0.1, 0.1))
    blue = replace(plain, color="blue")
    assert build_world((red, blue), ()).denotes_only(Phrase("box", "red"), 0)
    assert not build_world((red, plain), ()).denotes_only(Phrase("box", "red"), 0)


def test_another_word_for_a_second_thing_makes_a_category_unclear() -> None:
    desk = SceneObject(0, "desk", "", (0.0, 0.0, 0.4), (0.5, 0.5, 0.4))
    table = SceneObject(1, "coffee table", "", (3.0, 0.0, 0.2), (0.5, 0.5, 0.2))
    world = build_world((desk, table), ())
    assert world.denotes_only(Phrase("desk"), 0)
    assert not world.denotes(Phrase("table")).any()
    assert world.denotes(Phrase("table"), lenient=True).tolist() == [True, True]


@pytest.mark.parametrize(("far_m", "clear"), [(1.2, False), (3.0, True)])
def test_closest_needs_a_plain_lead(far_m: float, clear: bool) -> None:
    window = SceneObject(0, "window", "", (0.0, 0.0, 1.5), (0.5, 0.05, 0.5))
    near = SceneObject(1, "chair", "red", (0.0, 1.0, 0.4), (0.2, 0.2, 0.4))
    far = SceneObject(2, "chair", "red", (0.0, -far_m, 0.4), (0.2, 0.2, 0.4))
    world = build_world((window, near, far), ())
    phrase = Phrase("chair", "", "", "closest to", 0, "window")
    assert world.denotes_only(phrase, 1) == clear


def test_rooms_of_one_kind_make_a_room_unclear() -> None:
    first = SceneObject(0, "bed", "", (0.0, 0.0, 0.3), (1.0, 1.0, 0.3), 0.0, "bedroom")
    second = SceneObject(1, "bed", "", (9.0, 0.0, 0.3), (1.0, 1.0, 0.3), 0.0, "bedroom 2")
    world = build_world((first, second), ())
    assert world.rooms == ("bedroom",)
    assert world.denotes(Phrase("bed", room="bedroom")).sum() == 2


def test_a_door_is_in_the_rooms_on_both_its_sides() -> None:
    door = SceneObject(0, "door", "", (0.0, 0.0, 1.0), (0.4, 0.05, 1.0), 0.0, "kitchen")
    other = SceneObject(1, "door", "", (0.0, 3.0, 1.0), (0.4, 0.05, 1.0), 0.0, "office")
    world = build_world((door, other), ())
    assert not world.denotes_only(Phrase("door", room="kitchen"), 0)


@pytest.mark.parametrize(
    ("word", "text"),
    [
        ("chair", "chairs"),
        ("box", "boxes"),
        ("couch", "couches"),
        ("bookshelf", "bookshelves"),
        ("toilet paper", "toilet paper rolls"),
        ("case of water bottles", "cases of water bottles"),
        ("stairs", "stairs"),
        ("tv", "tvs"),
        ("body", "bodies"),
        ("tray", "trays"),
    ],
)
def test_plural(word: str, text: str) -> None:
    assert plural(word) == text


def test_small_words() -> None:
    assert with_article("orange lamp") == "an orange lamp"
    assert with_article("red stairs", "stairs") == "red stairs"
    assert join_names(["a", "b", "c"], "or") == "a, b or c"
    assert (count_word(3), count_word(40)) == ("three", "40")
    assert capital("i am here. where is it? ok") == "I am here. Where is it? Ok"
    assert [room_word(r) for r in ("bedroom_2", "living room", "bath #1")] == ["bedroom", "living room", "bath"]


def test_may_be_called_is_reflexive_and_knows_head_nouns() -> None:
    assert may_be_called("kitchen cabinet", "cabinet")
    assert may_be_called("cabinet", "kitchen cabinet")
    assert may_be_called("sofa chair", "sofa chair")
    assert not may_be_called("table", "lamp")
