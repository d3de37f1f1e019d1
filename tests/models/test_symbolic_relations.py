"""How things stand to each other, judged from views of painted boxes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pipeline.models.symbolic import relations
from pipeline.models.symbolic.perceive import perceive
from pipeline.models.symbolic.sentences import place_of
from pipeline.models.symbolic.view import View
from tests.models.symbolic_painting import Box, paint, room

DESK = (
    Box("desk", (0, 3.0), (1.2, 0.05, 0.7), foot=0.7, color="brown"),
    Box("desk", (-0.57, 3.0), (0.06, 0.7, 0.6), color="brown"),
    Box("desk", (0.57, 3.0), (0.06, 0.7, 0.6), color="brown"),
)
COUCH = Box("couch", (0, 3.0), (1.8, 0.7, 0.8), color="blue")
FAR_COUCH = Box("couch", (0, 4.5), (1.8, 0.7, 0.8), color="blue")
PICTURE = Box("picture", (0, 4.98), (0.6, 0.5, 0.04), foot=1.2)


def see(*boxes: Box, pitch: float = 15.0) -> View:
    return perceive(paint(room(*boxes), pitch=pitch))


def index(view: View, name: str) -> int:
    found = view.named(frozenset({name}))
    assert found, f"no {name} among {[thing.name for thing in view.things]}"
    return found[0]


CASES: list[tuple[str, Callable[[View, int, int], float], tuple[Box, ...], str, str]] = [
    ("on a desk", relations.on, (*DESK, Box("laptop", (0, 3.0), (0.35, 0.2, 0.25), foot=0.75)), "laptop", "desk"),
    ("on the floor", relations.on, (Box("box", (0, 3.0), (0.4, 0.4, 0.4)),), "box", "floor"),
    ("on the wall", relations.on, (PICTURE,), "picture", "wall"),
    ("under a desk", relations.under, (*DESK, Box("trash can", (0, 3.0), (0.3, 0.35, 0.3))), "trash can", "desk"),
    ("behind a couch", relations.behind, (COUCH, Box("lamp", (0.3, 3.9), (0.3, 1.4, 0.3))), "lamp", "couch"),
    ("in front of a couch", relations.in_front, (COUCH, Box("box", (0, 2.2), (0.4, 0.3, 0.3))), "box", "couch"),
    ("next to a couch", relations.next_to, (COUCH, Box("lamp", (1.2, 3.0), (0.3, 1.2, 0.3))), "lamp", "couch"),
    ("left of a couch", relations.left, (COUCH, Box("lamp", (-1.3, 3.0), (0.3, 1.2, 0.3))), "lamp", "couch"),
    ("right of a couch", relations.right, (COUCH, Box("lamp", (1.3, 3.0), (0.3, 1.2, 0.3))), "lamp", "couch"),
    ("above a couch", relations.above, (FAR_COUCH, PICTURE), "picture", "couch"),
]


@pytest.mark.parametrize(("relation", "boxes", "first", "second"), [c[1:] for c in CASES], ids=[c[0] for c in CASES])
def test_relation_holds_one_way_only(
    relation: Callable[[View, int, int], float], boxes: tuple[Box, ...], first: str, second: str
) -> None:
    view = see(*boxes)
    a, b = index(view, first), index(view, second)

    assert relation(view, a, b) == 1.0
    if relation is not relations.next_to:
        assert relation(view, b, a) == 0.0


def test_inside_of_an_open_box_holds_and_not_of_a_thing_that_holds_nothing() -> None:
    ball = Box("ball", (0, 3.0), (0.3, 0.3, 0.3), foot=0.05, color="red")
    sides = [((0, 3.35), (0.7, 0.4, 0.05)), ((-0.35, 3.0), (0.05, 0.4, 0.7)), ((0.35, 3.0), (0.05, 0.4, 0.7))]
    for name, expected in (("basket", 1.0), ("piano", 0.0)):
        view = see(
            *(Box(name, at, size) for at, size in sides), Box(name, (0, 3.0), (0.7, 0.04, 0.7)), ball, pitch=30.0
        )
        assert relations.inside(view, index(view, "ball"), index(view, name)) == expected


def test_relation_between_holds_on_the_line_and_not_beside_it() -> None:
    left, right = Box("bed", (-1.2, 3.0), (0.8, 0.5, 1.0)), Box("desk", (1.2, 3.0), (0.8, 0.7, 0.6))
    for at, expected in (((0.0, 3.0), 1.0), ((0.0, 1.9), 0.0)):
        view = see(left, right, Box("stool", at, (0.3, 0.4, 0.3)), pitch=25.0)
        found = relations.between(view, index(view, "stool"), index(view, "bed"), index(view, "desk"))
        assert found == expected


def test_on_something_lower_behind_it_does_not_hold() -> None:
    # The lamp's foot ends at the bed's edge in the image, but it stands on the floor a metre behind the bed.
    view = see(Box("bed", (0, 2.6), (1.6, 0.5, 1.0)), Box("lamp", (0, 4.2), (0.3, 1.5, 0.3)))

    assert relations.on(view, index(view, "lamp"), index(view, "bed")) == 0.0
    assert relations.behind(view, index(view, "lamp"), index(view, "bed")) == 1.0


def test_behind_of_what_is_wholly_hidden_cannot_be_seen() -> None:
    view = see(Box("wardrobe", (0, 3.0), (1.2, 2.0, 0.6)), Box("box", (0, 4.0), (0.3, 0.3, 0.3)))

    assert not view.named(frozenset({"box"}))


def test_next_to_falls_off_with_the_gap() -> None:
    degrees = []
    for x in (1.2, 1.8, 2.4):
        view = see(Box("couch", (-0.8, 3.5), (1.6, 0.7, 0.8)), Box("lamp", (x - 0.8, 3.5), (0.2, 1.2, 0.2)))
        degrees.append(relations.next_to(view, index(view, "lamp"), index(view, "couch")))

    assert degrees[0] == 1.0
    assert 0.0 < degrees[1] < 1.0
    assert degrees[2] == 0.0


@pytest.mark.parametrize(
    ("boxes", "name", "place"),
    [
        ((*DESK, Box("laptop", (0, 3.0), (0.35, 0.2, 0.25), foot=0.75)), "laptop", "on the desk"),
        ((*DESK, Box("trash can", (0, 3.0), (0.3, 0.35, 0.3))), "trash can", "under the desk"),
        ((COUCH, Box("lamp", (1.2, 3.0), (0.3, 1.2, 0.3))), "lamp", "next to the couch"),
        ((PICTURE,), "picture", "on the wall"),
        ((Box("ball", (0, 3.0), (0.4, 0.4, 0.4)),), "ball", "on the floor"),
    ],
)
def test_place_of_says_what_holds_a_thing_before_what_is_beside_it(
    boxes: tuple[Box, ...], name: str, place: str
) -> None:
    view = see(*boxes)

    found = place_of(view, index(view, name))

    assert found is not None
    assert found[0] == place
