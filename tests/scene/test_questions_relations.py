"""Relations: stated ones, those read off boxes, and the law that the strict sense implies the lenient one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.scene.objects import SceneObject
from pipeline.scene.questions.layout import measure_layout
from pipeline.scene.questions.relations import Relations, find_relations
from tests.scene.home import build_home

TABLE = SceneObject(0, "table", "brown", (0.0, 0.0, 0.4), (0.8, 0.5, 0.4))
CUP = SceneObject(1, "cup", "red", (0.3, 0.1, 0.85), (0.05, 0.05, 0.05))
BALL = SceneObject(2, "ball", "blue", (0.0, 0.0, 0.12), (0.12, 0.12, 0.12))
CHAIR = SceneObject(3, "chair", "green", (1.3, 0.0, 0.45), (0.25, 0.25, 0.45))
PICTURE = SceneObject(4, "picture", "", (0.0, 0.55, 1.5), (0.3, 0.02, 0.3))
BASKET = SceneObject(5, "basket", "white", (3.0, 3.0, 0.2), (0.3, 0.3, 0.2))
TOY = SceneObject(6, "toy", "pink", (3.0, 3.0, 0.15), (0.1, 0.1, 0.1))
SCANNED = (TABLE, CUP, BALL, CHAIR, PICTURE, BASKET, TOY)


def relate(objects: tuple[SceneObject, ...]) -> Relations:
    return find_relations(objects, measure_layout(objects))


@pytest.mark.parametrize(
    ("name", "pairs"),
    [
        ("on", {(1, 0)}),
        ("under", {(2, 0)}),
        ("in", {(6, 5)}),
        ("above", {(4, 0)}),
        ("next to", {(3, 0), (0, 3)}),
        ("behind", set()),
    ],
)
def test_relations_of_a_scan_follow_from_boxes(name: str, pairs: set[tuple[int, int]]) -> None:
    holds = relate(SCANNED).holds[name]
    assert {(int(i), int(j)) for i, j in np.argwhere(holds)} == pairs


def test_relations_through_a_wall_do_not_hold() -> None:
    chair = replace(CHAIR, room="kitchen")
    table = replace(TABLE, room="office")
    assert not relate((table, chair)).may_hold["next to"].any()


def test_stated_relations_override_boxes() -> None:
    home = build_home()
    relations = relate(home)
    names = {o.instance: o.category for o in home}
    stated = {(o.category, o.relation, names[o.parent]) for o in home if o.parent >= 0}
    found = {
        (home[i].category, name, home[j].category)
        for name in ("on", "in", "under", "behind")
        for i, j in np.argwhere(relations.holds[name])
    }
    assert found == stated
    assert relations.complete


def test_a_thing_on_the_side_where_something_is_stated_behind_may_be_behind() -> None:
    couch = SceneObject(0, "couch", "", (0.0, 0.0, 0.4), (1.0, 0.4, 0.4))
    ball = SceneObject(1, "ball", "", (0.0, 0.6, 0.1), (0.1, 0.1, 0.1), 0.0, "", (), 0, "behind")
    box = SceneObject(2, "box", "", (0.5, 0.6, 0.1), (0.1, 0.1, 0.1))
    mat = SceneObject(3, "mat", "", (0.0, -0.8, 0.1), (0.3, 0.3, 0.1))
    may = relate((couch, ball, box, mat)).may_hold["behind"]
    assert may[:, 0].tolist() == [False, True, True, False]


def test_a_scan_is_never_complete() -> None:
    assert not relate(SCANNED).complete
    assert not relate((TABLE, replace(CUP, parent=0, relation="on"))).complete


CATEGORIES = ["table", "bed", "cup", "basket", "chair", "wall", "picture", "couch", "book"]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(CATEGORIES),
            st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(0, 2)),
            st.tuples(*[st.floats(0.05, 0.8)] * 3),
            st.floats(0, 1.5),
        ),
        min_size=2,
        max_size=7,
    )
)
def test_what_holds_may_hold_and_structure_and_self_never_do(
    numbers: list[tuple[str, tuple[float, float, float], tuple[float, float, float], float]],
) -> None:
    objects = tuple(SceneObject(i, name, "", at, half, yaw) for i, (name, at, half, yaw) in enumerate(numbers))
    relations = relate(objects)
    wall = np.array([o.category == "wall" for o in objects])
    for name, holds in relations.holds.items():
        may = relations.may_hold[name]
        assert (holds <= may).all(), name
        assert not np.diag(may).any(), name
        assert not may[wall].any(), name
        assert not may[:, wall].any(), name
