"""The Gaussians while they are trained: parameters, Adam's moments and what density control has seen, row by row.

All rows are kept together, so that Gaussians which are dropped or added take or bring their own state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int32, Int64
from torch import Tensor

from pipeline.scene import Gaussians
from pipeline.scene.gaussians import SH_COUNTS

PARAMETERS = ("means", "quats", "log_scales", "opacity_logits", "sh")
"""Fields of `Gaussians`, in order."""
FLATTEST = float(np.log(1e-5))
"""Log scales start no lower: a flat axis (-inf) has no gradient, one of ten micrometres does."""
STEEPEST_LOGIT = 12.0
"""Opacity logits start within this: opacity 1 to float32 rounding, and a gradient."""


@dataclass(frozen=True, slots=True)
class TrainState:
    """M Gaussians in training; tensors are changed in place."""

    values: dict[str, Tensor]
    """Raw parameters by the names of `PARAMETERS`, float32."""
    first: dict[str, Tensor]
    """Adam's mean gradient of each."""
    second: dict[str, Tensor]
    """Adam's mean squared gradient of each."""
    updates: Int32[Tensor, "M"]
    """Steps of Adam each row has taken."""
    pull: Float[Tensor, "M"]
    """Sum of pulls at the projected centre since the last round of density control."""
    looks: Int32[Tensor, "M"]
    """Images that were in that sum."""

    @staticmethod
    def of(gaussians: Gaussians, sh_degree: int, device: str = "cpu") -> TrainState:
        """Return the state before the first step; coefficients beyond those the Gaussians have are 0.

        Args:
            gaussians: The start.
            sh_degree: Degree to store; what the start has beyond it is dropped.
            device: Where to train.
        """
        sh = np.zeros((len(gaussians), SH_COUNTS[sh_degree], 3), np.float32)
        shared = min(sh.shape[1], gaussians.sh.shape[1])
        sh[:, :shared] = gaussians.sh[:, :shared]
        quats = gaussians.quats / np.abs(gaussians.quats).max(axis=1, keepdims=True)
        arrays = {
            "means": np.array(gaussians.means),
            "quats": quats / np.linalg.norm(quats, axis=1, keepdims=True),
            "log_scales": np.maximum(gaussians.log_scales, np.float32(FLATTEST)),
            "opacity_logits": np.clip(gaussians.opacity_logits, -STEEPEST_LOGIT, STEEPEST_LOGIT).astype(np.float32),
            "sh": sh,
        }
        return TrainState.fresh({name: torch.from_numpy(array).to(device) for name, array in arrays.items()})

    @staticmethod
    def fresh(values: Mapping[str, Tensor]) -> TrainState:
        """Return parameters that have seen no gradient yet."""
        count, device = len(values["means"]), values["means"].device
        return TrainState(
            values=dict(values),
            first={name: torch.zeros_like(value) for name, value in values.items()},
            second={name: torch.zeros_like(value) for name, value in values.items()},
            updates=torch.zeros(count, dtype=torch.int32, device=device),
            pull=torch.zeros(count, device=device),
            looks=torch.zeros(count, dtype=torch.int32, device=device),
        )

    def __len__(self) -> int:
        return len(self.updates)

    def take(self, rows: Int64[Tensor, "n"] | Bool[Tensor, "M"]) -> TrainState:
        """Return some rows with all that is known of them."""
        return TrainState(
            *({name: value[rows] for name, value in table.items()} for table in self._tables()),
            *(column[rows] for column in self._columns()),
        )

    def joined(self, other: TrainState) -> TrainState:
        """Return these rows and then the other ones."""
        tables = zip(self._tables(), other._tables(), strict=True)
        columns = zip(self._columns(), other._columns(), strict=True)
        return TrainState(
            *({name: torch.cat([ours[name], theirs[name]]) for name in PARAMETERS} for ours, theirs in tables),
            *(torch.cat(pair) for pair in columns),
        )

    def gaussians(self) -> Gaussians:
        """Return the parameters as they are."""
        return Gaussians(*(self.values[name].cpu().numpy().copy() for name in PARAMETERS))

    def arrays(self) -> dict[str, np.ndarray]:
        """Return everything under names of its own, for a checkpoint."""
        named = {}
        for title, table in zip(("value", "first", "second"), self._tables(), strict=True):
            named.update({f"{title}.{name}": tensor.cpu().numpy() for name, tensor in table.items()})
        for title, column in zip(("updates", "pull", "looks"), self._columns(), strict=True):
            named[title] = column.cpu().numpy()
        return named

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], device: str = "cpu") -> TrainState:
        """Return the state that `arrays` gave."""
        tables = (
            {name: torch.from_numpy(arrays[f"{title}.{name}"]).to(device) for name in PARAMETERS}
            for title in ("value", "first", "second")
        )
        columns = (torch.from_numpy(arrays[title]).to(device) for title in ("updates", "pull", "looks"))
        return TrainState(*tables, *columns)

    def _tables(self) -> tuple[dict[str, Tensor], dict[str, Tensor], dict[str, Tensor]]:
        return self.values, self.first, self.second

    def _columns(self) -> tuple[Tensor, Tensor, Tensor]:
        return self.updates, self.pull, self.looks
