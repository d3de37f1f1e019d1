from __future__ import annotations

import numpy as np
import pytest

from tests.construct import tiny_capture

torch = pytest.importorskip("torch")

from pipeline.construct.training.sparse_adam import adam_step, sparse_adam, torch_step  # noqa: E402
from pipeline.construct.training.train_state import PARAMETERS, TrainState  # noqa: E402

ROWS = 50


def _state() -> TrainState:
    return TrainState.of(tiny_capture.truth(ROWS), sh_degree=1)


def _gradients(state: TrainState, ids: torch.Tensor, seed: int) -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return {name: torch.randn(value[ids].shape, generator=generator) for name, value in state.values.items()}


def _rates(state: TrainState, rate: float = 0.01) -> dict[str, torch.Tensor]:
    return {name: torch.full((value[0].numel(),), rate) for name, value in state.values.items()}


def test_with_all_rows_it_is_the_adam_of_torch() -> None:
    state, ids = _state(), torch.arange(ROWS)
    theirs = [value.clone().requires_grad_() for value in state.values.values()]
    adam = torch.optim.Adam(theirs, lr=0.01, eps=1e-15)
    for seed in range(5):
        gradients = _gradients(state, ids, seed)
        for value, gradient in zip(theirs, gradients.values(), strict=True):
            value.grad = gradient
        adam.step()
        sparse_adam(state, ids, gradients, _rates(state), threads=2)
    for name, value in zip(PARAMETERS, theirs, strict=True):
        torch.testing.assert_close(state.values[name], value.detach(), rtol=1e-5, atol=1e-6)


def test_rows_that_are_not_given_or_not_shown_keep_every_bit() -> None:
    state, ids = _state(), torch.arange(0, ROWS, 2)
    sparse_adam(state, torch.arange(ROWS), _gradients(state, torch.arange(ROWS), 0), _rates(state))
    before = {name: array.copy() for name, array in state.arrays().items()}
    gradients = _gradients(state, ids, 1)
    gradients["opacity_logits"][3] = 0.0  # row 6
    sparse_adam(state, ids, gradients, _rates(state))
    still = np.ones(ROWS, bool)
    still[ids.numpy()] = False
    still[6] = True
    for name, array in state.arrays().items():
        assert np.array_equal(array[still], before[name][still]), name
        if name not in ("pull", "looks"):
            assert not (array[~still] == before[name][~still]).reshape((~still).sum(), -1).all(axis=1).any(), name


def test_a_row_seen_late_starts_with_a_whole_step() -> None:
    state, rates = _state(), {"opacity_logits": torch.tensor([0.5])}
    for _ in range(100):
        sparse_adam(state, torch.tensor([0]), {"opacity_logits": torch.tensor([1.0])}, rates)
    before = float(state.values["opacity_logits"][1])
    sparse_adam(state, torch.tensor([1]), {"opacity_logits": torch.tensor([-2.0])}, rates)
    assert float(state.values["opacity_logits"][1]) - before == pytest.approx(0.5, rel=1e-5)


def test_fewer_rates_leave_the_rest_of_a_row() -> None:
    state, ids = _state(), torch.arange(ROWS)
    before = state.values["sh"].clone()
    sparse_adam(state, ids, _gradients(state, ids, 0), {**_rates(state), "sh": torch.full((3,), 0.1)})
    assert torch.equal(state.values["sh"][:, 1:], before[:, 1:])
    assert bool((state.values["sh"][:, 0] != before[:, 0]).all())


def test_threads_and_torch_operations_agree_with_one_thread() -> None:
    rng = np.random.default_rng(0)
    count = 20_000
    ids = torch.from_numpy(np.sort(rng.choice(count, 18_000, replace=False)))
    gradient = torch.from_numpy(rng.normal(size=(len(ids), 3)).astype(np.float32))
    shown, rates = torch.from_numpy(rng.random(len(ids)) < 0.8), torch.tensor([0.1, 0.2])
    updates = torch.from_numpy(rng.integers(1, 9, count).astype(np.int32))
    tables = [torch.from_numpy(rng.random((count, 3), np.float32)) for _ in range(3)]
    one, two, plain = ([table.clone() for table in tables] for _ in range(3))
    adam_step(*one, updates, ids, gradient, rates, shown)
    adam_step(*two, updates, ids, gradient, rates, shown, threads=2)
    torch_step(plain, updates, ids, gradient, rates, shown, 0.999)
    for a, b, c in zip(one, two, plain, strict=True):
        assert torch.equal(a, b)
        # Moments of either sign cancel to a few units in the last place of numbers near 1.
        torch.testing.assert_close(a, c, rtol=1e-5, atol=1e-5)
    assert not torch.equal(one[0], tables[0])


def test_an_image_that_shows_nothing_moves_nothing() -> None:
    state = _state()
    before = state.values["means"].clone()
    sparse_adam(state, torch.arange(0), _gradients(state, torch.arange(0), 0), _rates(state))
    assert torch.equal(state.values["means"], before)
