"""What each photograph may have of its own: exposure, and a pose a little off. Fitted beside the scene, then dropped.

Held-out frames get none of it: the scene is judged at the poses and exposures that were recorded.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pipeline.construct.photos.camera_motion import moved
from pipeline.construct.training.sparse_adam import adam_step
from pipeline.construct.training.train_config import TrainConfig
from pipeline.geometry import Camera

EXPOSURES, POSES = "exposures", "poses"


class PhotoCorrections:
    """Corrections of N photographs; all zero, and left at that, unless the settings ask for them.

    Args:
        count: N.
        config: Which are fitted, and their rates.
        device: Where to train.
    """

    def __init__(self, count: int, config: TrainConfig, device: str = "cpu") -> None:
        self._config = config
        shapes = {EXPOSURES: (count, 2, 3), POSES: (count, 6)}
        self._tables = {
            f"{name}.{part}": torch.zeros(shape, device=device)
            for name, shape in shapes.items()
            for part in ("value", "first", "second")
        }
        self._updates = torch.zeros(count, dtype=torch.int32, device=device)

    def camera(self, index: int, camera: Camera) -> Camera:
        """Return the camera of a photograph at its fitted pose."""
        return (
            moved(camera, self._tables[f"{POSES}.value"][index].cpu().double().numpy())
            if self._config.refine_poses
            else camera
        )

    def exposure(self, index: int) -> Float[Tensor, "2 3"] | None:
        """Return the log gain and the offset of a photograph's channels as a leaf; None where they are not fitted."""
        if not self._config.exposure:
            return None
        return self._tables[f"{EXPOSURES}.value"][index].clone().requires_grad_()

    def step(self, index: int, exposure: Float[Tensor, "2 3"] | None, pose_gradient: Float[Tensor, "6"] | None) -> None:
        """Move one photograph's corrections by a step of Adam; gradients that are None leave theirs."""
        self._updates[index] += 1
        rates = self._config.rates
        if exposure is not None and exposure.grad is not None:
            self._step(EXPOSURES, index, exposure.grad, rates.exposures)
        if pose_gradient is not None:
            self._step(POSES, index, pose_gradient, rates.poses)

    def center(self) -> None:
        """Take the mean correction away: what all photographs share belongs to the scene."""
        for name in (EXPOSURES, POSES):
            table = self._tables[f"{name}.value"]
            table -= table.mean(dim=0, keepdim=True)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return everything under names of its own, for a checkpoint."""
        return {
            **{name: table.cpu().numpy() for name, table in self._tables.items()},
            "photo updates": self._updates.cpu().numpy(),
        }

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Take over what `arrays` gave."""
        for name, table in self._tables.items():
            table.copy_(torch.from_numpy(arrays[name]))
        self._updates.copy_(torch.from_numpy(arrays["photo updates"]))

    def _step(self, name: str, index: int, gradient: Tensor, rate: float) -> None:
        values, first, second = (self._tables[f"{name}.{part}"] for part in ("value", "first", "second"))
        ids = torch.tensor([index], device=values.device)
        rates = torch.full((gradient.numel(),), rate, device=values.device)
        adam_step(values, first, second, self._updates, ids, gradient[None], rates, beta2=self._config.beta2)


def pose_gradient(
    camera: Camera,
    means: Float[Tensor, "n 3"],
    quats: Float[Tensor, "n 4"],
    by_means: Float[Tensor, "n 3"],
    by_quats: Float[Tensor, "n 4"],
) -> Float[Tensor, "6"]:
    """Return the gradient by a `moved` camera's twist at 0, from those of the Gaussians in front of it.

    To move the camera is to move all Gaussians rigidly the other way about. Their colours are held fixed, as they are
    with spherical harmonics of degree 0.

    Args:
        camera: The camera.
        means: Centres, metres.
        quats: wxyz.
        by_means: Gradient by the centres.
        by_quats: Gradient by the unnormalised quaternions.
    """
    pose = torch.from_numpy(np.array(camera.world_to_camera)).to(means)
    local, slopes = means @ pose[:, :3].T + pose[:, 3], by_means @ pose[:, :3].T
    w, x, y, z = quats.unbind(1)
    turned = torch.stack(
        [torch.stack(row, 1) for row in ((-x, w, -z, y), (-y, z, w, -x), (-z, -y, x, w))]
    )  # quats moved by a turn about each world axis, times two
    by_world_turn = 0.5 * (turned * by_quats).sum(dim=(1, 2))
    by_turn = torch.linalg.cross(local, slopes).sum(dim=0) + pose[:, :3] @ by_world_turn
    return torch.cat([slopes.sum(dim=0), by_turn])
