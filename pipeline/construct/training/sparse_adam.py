"""Adam that touches only the rows an image shows: their parameters and moments, nothing of the others."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Bool, Float, Int32, Int64
from torch import Tensor

from pipeline.construct.training.sparse_adam_kernels import adam_rows
from pipeline.construct.training.train_state import TrainState
from pipeline.render.threads import run_each, split

BETA1 = 0.9
"""Memory of the mean gradient, as in 3DGS."""
EPSILON = 1e-15
"""3DGS's: gradients are sums over pixels divided by their number, far smaller than those Adam's 1e-8 is made for."""
CHUNK = 1 << 13
"""Rows a thread takes at once."""


def sparse_adam(
    state: TrainState,
    ids: Int64[Tensor, "n"],
    gradients: Mapping[str, Tensor],
    rates: Mapping[str, Tensor],
    *,
    beta2: float = 0.999,
    threads: int = 1,
) -> None:
    """Move n Gaussians by one step of Adam; all others, and those of the n without any gradient, stay as they are.

    Moments of a row that is left out do not decay, and each row counts its own steps, so that one which is seen for
    the first time late in training starts with a whole step and not with three.

    Args:
        state: Changed in place.
        ids: Rows, without repeats.
        gradients: By parameter, n rows each, opacity among them: where its gradient is 0, no pixel showed the row.
        rates: Learning rates by parameter: one for each number of a row; fewer leave the rest of the row.
        beta2: Memory of the squared gradients, 0 to 1.
        threads: Threads; no number of them changes a result.
    """
    shown = gradients["opacity_logits"] != 0
    state.updates[ids] += shown.to(state.updates.dtype)
    for name, gradient in gradients.items():
        tables = (state.values[name], state.first[name], state.second[name])
        adam_step(*tables, state.updates, ids, gradient, rates[name], shown, beta2=beta2, threads=threads)


def adam_step(
    values: Float[Tensor, "M ..."],
    first: Float[Tensor, "M ..."],
    second: Float[Tensor, "M ..."],
    updates: Int32[Tensor, "M"],
    ids: Int64[Tensor, "n"],
    gradient: Float[Tensor, "n ..."],
    rates: Float[Tensor, "c"],
    shown: Bool[Tensor, "n"] | None = None,
    *,
    beta2: float = 0.999,
    threads: int = 1,
) -> None:
    """Move rows of one table by a step of Adam (Kingma and Ba 2015, algorithm 1), in place.

    Args:
        values: Parameters.
        first: Mean gradients.
        second: Mean squared gradients.
        updates: The step each row is at, from 1.
        ids: Rows, without repeats.
        gradient: Their gradients.
        rates: Learning rates of the first c numbers of a row; the others are left.
        shown: Which of the n rows move; None for all.
        beta2: Memory of the squared gradients, 0 to 1.
        threads: Threads; no number of them changes a result.
    """
    shown = torch.ones(len(ids), dtype=torch.bool, device=ids.device) if shown is None else shown
    *tables, flat = (_flat(table) for table in (values, first, second, gradient))
    if flat.device.type == "cpu":
        _compiled_step(tables, updates, ids, flat, rates, shown, beta2, threads)
    else:
        torch_step(tables, updates, ids, flat, rates, shown, beta2)


def torch_step(
    tables: list[Tensor], updates: Tensor, ids: Tensor, flat: Tensor, rates: Tensor, shown: Tensor, beta2: float
) -> None:
    """Do the same by torch's operations, on any device: tables (M, C) of values, mean and mean squared gradients."""
    ids, flat = ids[shown], flat[shown, : len(rates)]
    parameters, mean, square = (table[:, : len(rates)] for table in tables)
    done = updates[ids].to(flat.dtype)[:, None]
    mean[ids] = m = BETA1 * mean[ids] + (1.0 - BETA1) * flat
    square[ids] = s = beta2 * square[ids] + (1.0 - beta2) * flat**2
    parameters[ids] -= rates * (m / (1.0 - BETA1**done)) / ((s / (1.0 - beta2**done)).sqrt() + EPSILON)


def _flat(table: Tensor) -> Tensor:
    """Return a row's numbers side by side; with no rows, too, which `reshape` cannot."""
    return table.flatten(1) if table.ndim > 1 else table[:, None]


def _compiled_step(
    tables: list[Tensor],
    updates: Tensor,
    ids: Tensor,
    gradient: Tensor,
    rates: Tensor,
    shown: Tensor,
    beta2: float,
    threads: int,
) -> None:
    values, mean, square = (table.numpy() for table in tables)
    columns = (ids.numpy(), shown.numpy(), updates.numpy(), rates.contiguous().numpy(), gradient.contiguous().numpy())
    numbers = (np.float32(BETA1), np.float32(beta2), np.float32(EPSILON))
    chunks = split(len(ids), -(-len(ids) // CHUNK)) if len(ids) else []

    def work(k: int) -> None:
        adam_rows(*chunks[k], *columns, values, mean, square, *numbers)

    run_each(work, len(chunks), threads)
