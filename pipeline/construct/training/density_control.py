"""Adaptive density control of 3DGS (Kerbl et al. 2023, section 5): clone, split, prune, and the cut of opacities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from pipeline.construct.training.train_config import DensityConfig
from pipeline.construct.training.train_state import TrainState

HALF = 0.5**0.5
"""Two halves of a Gaussian lie this many of its longest deviations either side of its centre, and are that much shorter
along it: together they spread as far as it did. 3DGS draws both from it and shrinks every axis to 1 / 1.6, which leaves
gaps that hundreds of steps do not close."""


@dataclass(frozen=True, slots=True)
class DensityRound:
    """What one round did."""

    cloned: int
    """Gaussians that got a twin."""
    split: int
    """Gaussians replaced by two smaller ones."""
    pruned: int
    """Gaussians dropped."""


def control_density(state: TrainState, config: DensityConfig, extent_m: float) -> tuple[TrainState, DensityRound]:
    """Return the state after one round, with sums of pulls at 0.

    Gaussians with a strong mean pull are cloned where they are small, and otherwise cut in two across their longest
    axis; where a round's growth or the cap leave less room, the strongest pulls come first (ties: the lower row). Kept
    rows keep Adam's state, new rows start without. Faint Gaussians are pruned, and metres-wide ones.

    Args:
        state: Not changed.
        config: Thresholds and cap.
        extent_m: Extent of the camera path, metres.
    """
    strength = torch.where(state.looks > 0, state.pull / state.looks.clamp(min=1), torch.zeros_like(state.pull))
    largest = state.values["log_scales"].amax(dim=1).exp()
    faint = torch.sigmoid(state.values["opacity_logits"]) < config.least_opacity
    dropped = faint | (largest > config.largest_extent * extent_m)
    left = int((~dropped).sum())
    room = max(0, min(config.most - left, int(config.growth * left)))
    wanted = (~dropped & (strength >= config.gradient)).nonzero()[:, 0]
    order = torch.argsort(strength[wanted], descending=True, stable=True)[:room]
    chosen = wanted[order].sort().values
    small = largest[chosen] <= config.dense_extent * extent_m
    cloned, halved = chosen[small], chosen[~small]
    dropped[halved] = True
    kept = state.take(~dropped)
    added = TrainState.fresh({name: value[cloned] for name, value in state.values.items()})
    result = kept.joined(added).joined(_halves(state, halved))
    result.pull.zero_()
    result.looks.zero_()
    return result, DensityRound(len(cloned), len(halved), int(dropped.sum()) - len(halved))


def cut_opacities(state: TrainState, opacity: float) -> None:
    """Lower every opacity to at most `opacity`, and forget Adam's moments of them (3DGS's opacity reset)."""
    state.values["opacity_logits"].clamp_(max=float(np.log(opacity / (1.0 - opacity))))
    state.first["opacity_logits"].zero_()
    state.second["opacity_logits"].zero_()


def _halves(state: TrainState, rows: Int64[Tensor, "n"]) -> TrainState:
    """Return two Gaussians for each row, either side of its centre: n first ones, then n second ones."""
    values = {name: value[rows].repeat(2, *[1] * (value.ndim - 1)) for name, value in state.values.items()}
    log_scale, axis = values["log_scales"].max(dim=1)
    each = torch.arange(len(axis), device=axis.device)
    offset = HALF * log_scale.exp()
    offset[: len(rows)] *= -1.0
    values["means"] = values["means"] + rotations(values["quats"])[each, :, axis] * offset[:, None]
    values["log_scales"][each, axis] += float(np.log(HALF))
    return TrainState.fresh(values)


def rotations(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Return the matrices of wxyz quaternions of any norm."""
    w, x, y, z = (quats / quats.norm(dim=1, keepdim=True)).unbind(1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=1).reshape(-1, 3, 3)
