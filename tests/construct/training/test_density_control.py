from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry import quats_to_rotations
from tests.construct import tiny_capture

torch = pytest.importorskip("torch")

from pipeline.construct.training.density_control import control_density, cut_opacities, rotations  # noqa: E402
from pipeline.construct.training.train_config import DensityConfig  # noqa: E402
from pipeline.construct.training.train_state import TrainState  # noqa: E402

CONFIG = DensityConfig(growth=1.0, gradient=1.0, dense_extent=0.1, largest_extent=1.0, least_opacity=0.1)
SMALL, LARGE = float(np.log(0.05)), float(np.log(0.5))
"""Log scales below and above `dense_extent`, with an extent of 1 m."""


def _state(count: int = 6) -> TrainState:
    """Rows with moments of their own; no row has been pulled at."""
    state = TrainState.of(tiny_capture.truth(count), sh_degree=0)
    state.values["log_scales"][:] = SMALL
    for name, moment in state.first.items():
        moment[:] = torch.arange(count).reshape(-1, *[1] * (state.values[name].ndim - 1)) + 1.0
    state.updates[:] = torch.arange(count) + 10
    state.looks[:] = 2
    return state


def test_without_pull_everything_stays_with_its_state() -> None:
    state = _state()
    after, did = control_density(state, CONFIG, 1.0)
    assert (did.cloned, did.split, did.pruned) == (0, 0, 0)
    for name, array in after.arrays().items():
        assert np.array_equal(array, state.arrays()[name]) or name == "looks"


def test_a_small_gaussian_with_a_strong_mean_pull_gets_a_twin_without_moments() -> None:
    state = _state()
    state.pull[:] = torch.tensor([0.0, 2.1, 1.9, 0.0, 0.0, 0.0])  # means 1.05 and 0.95
    after, did = control_density(state, CONFIG, 1.0)
    assert (did.cloned, did.split, did.pruned, len(after)) == (1, 0, 0, 7)
    assert torch.equal(after.values["means"][6], state.values["means"][1])
    assert after.updates.tolist() == [10, 11, 12, 13, 14, 15, 0]
    assert after.first["means"][:, 0].tolist() == [1, 2, 3, 4, 5, 6, 0]
    assert float(after.pull.sum()) == 0
    assert int(after.looks.sum()) == 0


def test_a_large_gaussian_is_cut_in_two_that_spread_as_far_as_it_did() -> None:
    state = _state(2)
    state.values["log_scales"][1] = torch.tensor([SMALL, LARGE, SMALL - 2])
    state.pull[1] = 3.0
    after, did = control_density(state, CONFIG, 1.0)
    assert (did.cloned, did.split, did.pruned, len(after)) == (0, 1, 0, 3)
    assert torch.equal(after.values["means"][0], state.values["means"][0])
    quats, scales = (after.values[name][1:].double().numpy() for name in ("quats", "log_scales"))
    axes = quats_to_rotations(quats) * np.exp(scales)[:, None, :]
    moved = (after.values["means"][1:] - state.values["means"][1]).double().numpy()
    each = axes @ axes.swapaxes(1, 2) + moved[:, :, None] * moved[:, None, :]
    whole = quats_to_rotations(state.values["quats"][1:].numpy())[0] * np.exp(state.values["log_scales"][1].numpy())
    assert each.mean(axis=0) == pytest.approx(whole @ whole.T, abs=1e-5)
    assert moved.sum(axis=0) == pytest.approx(0.0, abs=1e-6)
    assert np.exp(scales).max() < 0.8 * np.exp(LARGE)
    assert after.updates.tolist() == [10, 0, 0]


def test_faint_and_huge_gaussians_are_pruned_even_where_they_are_pulled_at() -> None:
    state = _state()
    state.values["opacity_logits"][2] = -3.0
    state.values["log_scales"][4] = 0.1
    state.pull[:] = torch.tensor([0.0, 0.0, 9.0, 0.0, 9.0, 0.0])
    after, did = control_density(state, CONFIG, 1.0)
    assert (did.cloned, did.split, did.pruned) == (0, 0, 2)
    assert after.updates.tolist() == [10, 11, 13, 15]


def test_the_cap_leaves_room_for_the_strongest_pulls() -> None:
    state = _state()
    state.pull[:] = torch.tensor([3.0, 9.0, 5.0, 9.0, 4.0, 0.0])
    state.values["log_scales"][3] = LARGE
    config = CONFIG.model_copy(update={"most": 8})
    after, did = control_density(state, config, 1.0)
    assert (did.cloned, did.split, len(after)) == (1, 1, 8)
    assert torch.equal(after.values["means"][5], state.values["means"][1])
    none, did = control_density(state, CONFIG.model_copy(update={"most": 3}), 1.0)
    assert (did.cloned, did.split, len(none)) == (0, 0, 6)


def test_a_round_adds_no_more_than_its_growth() -> None:
    state = _state()
    state.pull[:] = torch.tensor([3.0, 9.0, 5.0, 8.0, 4.0, 0.0])
    after, did = control_density(state, CONFIG.model_copy(update={"growth": 0.4}), 1.0)
    assert (did.cloned, len(after)) == (2, 8)
    assert torch.equal(after.values["means"][6:], state.values["means"][[1, 3]])


def test_cut_opacities_lowers_those_above_and_forgets_their_moments() -> None:
    state = _state()
    state.values["opacity_logits"][0] = -8.0
    cut_opacities(state, 0.01)
    opacity = torch.sigmoid(state.values["opacity_logits"])
    assert float(opacity[0]) < 0.001
    assert opacity[1:].numpy() == pytest.approx(0.01, rel=1e-4)
    assert float(state.first["opacity_logits"].abs().sum()) == 0
    assert float(state.first["means"].abs().sum()) > 0


def test_rotations_are_those_of_the_geometry_package() -> None:
    quats = np.random.default_rng(0).normal(size=(20, 4))
    assert rotations(torch.from_numpy(quats)).numpy() == pytest.approx(quats_to_rotations(quats), abs=1e-12)
