"""Categories and instances from labelled points: together, and never in contradiction."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.construct.distillation.ground_truth import ground_truth
from pipeline.construct.distillation.labelled_points import LabelledPoints
from schemas.errors import InputError
from tests.construct.distillation.test_distill import make

ROW = np.arange(8.0)[:, None] * [1.0, 0.0, 0.0]
"""Points a metre apart along x."""
SMALL = np.log(0.05)
VOCABULARY = ("chair", "desk", "wall")


def ids(*values: int) -> np.ndarray:
    return np.array(values, np.int32)


def test_each_gaussian_takes_instance_and_category_of_its_point() -> None:
    instance, category = ids(4, 4, 0, -1, -1, 9, 0, 2), ids(0, 0, 1, -1, 2, 1, 1, 0)
    found = ground_truth(make(ROW, SMALL), LabelledPoints(ROW, VOCABULARY, category, instance))
    np.testing.assert_array_equal(found.instance, instance)
    np.testing.assert_array_equal(found.category, category)
    # A wall without an instance is known; only what has neither is not.
    np.testing.assert_array_equal(found.votes.label < 0, [False, False, False, True, False, False, False, False])


def test_chairs_are_not_added_up_against_the_desk_between_them() -> None:
    points = LabelledPoints(
        np.array([[-0.05, 0, 0], [0.05, 0, 0], [0.01, 0, 0]]), VOCABULARY, ids(0, 0, 1), ids(1, 2, 3)
    )
    found = ground_truth(make([0, 0, 0], SMALL), points)
    assert found.instance is not None
    assert found.category is not None
    assert (found.instance[0], found.category[0]) == (3, 1)


def test_one_kind_of_label_alone_gives_that_kind() -> None:
    gaussians = make(ROW, SMALL)
    found = ground_truth(gaussians, LabelledPoints(ROW, instance=ids(1, 1, 2, 2, 3, 3, -1, -1)))
    assert found.category is None
    np.testing.assert_array_equal(found.instance, [1, 1, 2, 2, 3, 3, -1, -1])
    found = ground_truth(gaussians, LabelledPoints(ROW, VOCABULARY, ids(0, 1, 2, 0, 1, 2, 0, 1)))
    assert found.instance is None
    np.testing.assert_array_equal(found.category, [0, 1, 2, 0, 1, 2, 0, 1])


@pytest.mark.parametrize(("label", "aside"), [(1, 9.0), (-1, 0.0)])
def test_points_elsewhere_or_without_labels_are_refused(label: int, aside: float) -> None:
    with pytest.raises(InputError, match="other coordinates"):
        ground_truth(make(ROW + aside, SMALL), LabelledPoints(ROW, instance=ids(*[label] * 8)))
