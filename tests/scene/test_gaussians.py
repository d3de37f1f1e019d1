"""The Gaussians struct: what it refuses, that it cannot be changed, and what counts as unusable."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from pipeline.scene import Gaussians
from pipeline.scene.gaussians import SH_COUNTS, unusable_reasons
from schemas.errors import InputError
from tests.scene.making import random_gaussians

FIELDS = ("means", "quats", "log_scales", "opacity_logits", "sh")


def arrays(count: int = 6, degree: int = 1) -> dict[str, np.ndarray]:
    made = random_gaussians(count, degree)
    return {name: getattr(made, name).copy() for name in FIELDS}


@pytest.mark.parametrize("degree", SH_COUNTS)
def test_counts_degree_and_bytes_follow_the_arrays(degree: int) -> None:
    made = random_gaussians(7, degree)
    assert (len(made), made.sh_degree) == (7, degree)
    assert made.nbytes == 7 * 4 * (3 + 4 + 3 + 1 + 3 * SH_COUNTS[degree])


@pytest.mark.parametrize("name", FIELDS)
def test_arrays_are_read_only_and_the_callers_own_is_left_writable(name: str) -> None:
    given = arrays()
    made = Gaussians(**given)
    with pytest.raises(ValueError, match="read-only"):
        getattr(made, name)[0] = 0
    given[name][0] = 0


def test_strided_arrays_become_contiguous() -> None:
    given = arrays()
    given["means"] = np.asfortranarray(given["means"])
    assert Gaussians(**given).means.flags.c_contiguous


@pytest.mark.parametrize("name", FIELDS)
def test_other_lengths_are_an_input_error(name: str) -> None:
    # Under test the shape checks of jaxtyping see it first, and theirs is a TypeError.
    given = arrays()
    given[name] = given[name][:-1]
    with pytest.raises((InputError, TypeError)):
        Gaussians(**given)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("means", np.nan, "mean not finite"),
        ("means", np.inf, "mean not finite"),
        ("quats", np.nan, "quaternion not finite"),
        ("log_scales", np.inf, "scale not finite"),
        ("log_scales", np.nan, "scale not finite"),
        ("log_scales", 81.0, "scale not finite"),
        ("opacity_logits", np.nan, "opacity not a number"),
        ("sh", -np.inf, "colour not finite"),
    ],
)
def test_unusable_values_are_refused_and_found_by_reason(name: str, value: float, reason: str) -> None:
    given = arrays()
    given[name].reshape(6, -1)[2, 0] = value
    with pytest.raises(InputError, match=f"{reason}: expected usable values, found 1 of 6"):
        Gaussians(**given)
    found = {key: np.flatnonzero(mask).tolist() for key, mask in unusable_reasons(**given).items() if mask.any()}
    assert found == {reason: [2]}


def test_zero_quaternion_is_unusable_but_a_tiny_one_is_not() -> None:
    given = arrays()
    given["quats"][1] = (1e-30, 0, 0, 0)
    Gaussians(**given)
    given["quats"][1] = 0
    with pytest.raises(InputError, match="quaternion zero"):
        Gaussians(**given)


def test_opacities_of_exactly_0_and_1_and_flat_axes_are_usable() -> None:
    given = arrays()
    given["opacity_logits"][:2] = np.inf, -np.inf
    given["log_scales"][0] = -np.inf
    assert len(Gaussians(**given)) == 6


@pytest.mark.parametrize("ids", [np.array([4, 0, 4]), np.array([True, False] * 3), slice(1, 5, 2)])
def test_take_gives_the_rows_asked_for_in_order(ids: np.ndarray | slice) -> None:
    made = random_gaussians(6, 1)
    taken = made.take(ids)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(taken, name), getattr(made, name)[ids])


def test_take_of_nothing_is_empty() -> None:
    assert len(random_gaussians(6, 2).take(np.zeros(6, bool))) == 0


def test_gaussians_survive_pickling() -> None:
    made = random_gaussians(6, 2)
    back = pickle.loads(pickle.dumps(made))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(back, name), getattr(made, name))
