"""Variants of the kernels that `benchmarks/error_vs_time.py` compares draw what their names say."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.kernel_variants import Variant, variant_processes
from benchmarks.render import synthetic_room
from benchmarks.variant_kernels import best_polynomial
from pipeline.render import render, tile_kernels


def test_best_polynomial_of_degree_five_is_the_renderers() -> None:
    ours = [getattr(tile_kernels, f"E{k}") for k in range(6)]
    np.testing.assert_allclose(best_polynomial(5), ours, rtol=1e-6)


@pytest.mark.parametrize(("degree", "largest"), [(3, 1e-4), (4, 3e-6), (6, 2e-9)])
def test_best_polynomial_stays_near_the_exponential(degree: int, largest: float) -> None:
    x = np.linspace(-8, 0, 1001)
    error = np.polynomial.polynomial.polyval(x, best_polynomial(degree)) / np.exp2(x / 8) - 1
    assert largest / 4 < np.abs(error).max() < largest


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variant", "largest"),
    [(Variant("tiles", tile=8), 1e-6), (Variant("degree 3", degree=3), 1e-3), (Variant("degree 6", degree=6), 2e-6)],
    ids=lambda value: getattr(value, "name", None),
)
def test_variant_draws_the_same_image_but_for_its_error(variant: Variant, largest: float) -> None:
    scene, (camera,) = synthetic_room(5_000)
    view = camera.resized(101, 75)  # no tile is whole at the right and the lower edge
    exact = render(scene, view)
    with variant_processes([variant], scene, [view]) as (process,):
        found = process.frames()
    assert 0 < np.abs(found["color"][0] - exact.color).max() < largest
    assert np.mean(found["dominant"][0] == exact.dominant) > 0.999
