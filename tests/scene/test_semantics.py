"""Semantics: lengths, ids and names are checked on construction."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.scene import UNLABELLED, Scene, Semantics, View
from schemas.errors import InputError
from tests.scene.making import camera, random_gaussians, small_scene

IDS = np.array([0, 2, UNLABELLED, 2], np.int32)
NAMES = ("lamp", "bed", "chair")


def test_present_names_are_sorted_and_leave_out_what_no_gaussian_carries() -> None:
    assert Semantics(NAMES, IDS).present() == ("chair", "lamp")


def test_scene_without_categories_has_no_present_name() -> None:
    assert Semantics(NAMES).present() == ()
    assert Semantics((), embedding=np.ones((3, 2), np.float32)).present() == ()


def test_unlabelled_gaussians_give_no_name() -> None:
    assert Semantics(NAMES, np.full(4, UNLABELLED, np.int32)).present() == ()


@pytest.mark.parametrize(
    ("columns", "length"),
    [({}, 0), ({"category": IDS}, 4), ({"embedding": np.ones((3, 2), np.float16)}, 3), ({"instance": IDS}, 4)],
)
def test_length_is_that_of_any_column(columns: dict[str, np.ndarray], length: int) -> None:
    assert len(Semantics(NAMES, **columns)) == length


@pytest.mark.parametrize("value", [-2, 3])
def test_category_outside_the_vocabulary_is_an_input_error(value: int) -> None:
    with pytest.raises(InputError, match="category: expected ids from -1 to 2"):
        Semantics(NAMES, np.array([0, value], np.int32))


def test_instances_may_be_any_number() -> None:
    assert len(Semantics((), instance=np.array([900, -1], np.int32))) == 2


def test_repeated_name_is_an_input_error() -> None:
    with pytest.raises(InputError, match="distinct names"):
        Semantics(("bed", "bed"), np.array([0], np.int32))


def test_scene_needs_a_row_a_gaussian() -> None:
    scene = small_scene()
    with pytest.raises(InputError, match="semantics: expected 40 rows, found 4"):
        Scene("s", scene.gaussians, scene.views, Semantics(NAMES, IDS))


def test_scene_needs_distinct_view_names() -> None:
    views = (View("a", camera()), View("a", camera()))
    with pytest.raises(InputError, match="views: expected distinct names"):
        Scene("s", random_gaussians(4), views, Semantics(()))
