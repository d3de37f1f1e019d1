"""The optimisation of a scene's Gaussians against its photographs: 3DGS's loop, on a CPU or through gsplat on a GPU.

One step looks at one photograph. What a step does depends on its number, the settings and the state alone, never on
the steps of this session, so that a run that was killed and goes on from a checkpoint ends with the same bits (on a
CPU, and without a time limit).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pipeline.construct.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from pipeline.construct.training.density_control import control_density, cut_opacities
from pipeline.construct.training.losses import depth_weight, inverse_depth_loss, photometric_loss
from pipeline.construct.training.photo_corrections import PhotoCorrections, pose_gradient
from pipeline.construct.training.sparse_adam import sparse_adam
from pipeline.construct.training.train_config import TrainConfig
from pipeline.construct.training.train_progress import TrainProgress, held_out_quality
from pipeline.construct.training.train_state import PARAMETERS, TrainState
from pipeline.construct.training.train_views import TrainViews, extent_of
from pipeline.geometry import Camera
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame
from pipeline.scene.gaussians import SH_COUNTS
from schemas.errors import InputError, StoppedError

TILE = 16
"""Side of the tiles that are skipped, pixels: the rasteriser's."""
_SAME_RUN = ("minutes", "threads", "checkpoint_steps", "report_steps", "evaluate_steps")
"""Settings that may differ between the sessions of one run: they change no step."""


@dataclass(frozen=True, slots=True)
class Trained:
    """A scene that was optimised."""

    gaussians: Gaussians
    """As many as density control left, with the settings' degree of spherical harmonics."""
    history: tuple[TrainProgress, ...]
    """Every report, the last one at the end."""
    cameras: tuple[Camera, ...]
    """Of the frames: as given, or at the poses that were fitted where the settings ask for that."""


def train(
    start: Gaussians,
    frames: Sequence[Frame],
    config: TrainConfig | None = None,
    *,
    checkpoint: Path | None = None,
    progress: Callable[[TrainProgress], object] | None = None,
    stop: Callable[[], bool] | None = None,
    held_out: Sequence[Frame] = (),
    clock: Callable[[], float] = perf_counter,
) -> Trained:
    """Return the Gaussians fitted to the frames' photographs and, where there is any, to their depth.

    Args:
        start: Where to start from.
        frames: Posed photographs to fit.
        config: Settings; defaults where None.
        checkpoint: File to go on from, if it is there, and to save to; None keeps nothing.
        progress: Called with every report.
        stop: Asked before every step; when it says True the checkpoint is written and training ends.
        held_out: Frames that are looked at, never fitted.
        clock: Seconds, for the time limit and the reports; `time.process_time` where other work shares the machine.

    Raises:
        InputError: There is no Gaussian or no frame, one cannot be read, or the checkpoint is not one of this run.
        StoppedError: `stop` said so.
    """
    if len(start) == 0:
        raise InputError("training", field="start", expected="at least one Gaussian", found="none")
    with _one_torch_thread():
        trainer = _Trainer(start, frames, config or TrainConfig(), checkpoint, held_out, clock)
        while not trainer.done:
            if stop is not None and stop():
                trainer.save()
                raise StoppedError(f"training was stopped after {trainer.step} of {trainer.config.steps} steps")
            report = trainer.advance()
            if report is not None and progress is not None:
                progress(report)
        return trainer.finished(progress)


class _Trainer:
    """One session of a run."""

    def __init__(
        self,
        start: Gaussians,
        frames: Sequence[Frame],
        config: TrainConfig,
        checkpoint: Path | None,
        held_out: Sequence[Frame],
        clock: Callable[[], float] = perf_counter,
    ) -> None:
        self.config, self._checkpoint, self._held_out, self._clock = config, checkpoint, held_out, clock
        self._frames = frames
        self._views = TrainViews(frames, config.image_side, with_depth=config.depth_first > 0, device=config.device)
        self._extent_m = extent_of(self._views.cameras)
        self._rasterize = _rasterizer(config.device)
        self._corrections = PhotoCorrections(len(frames), config, config.device)
        self.state = TrainState.of(start, config.sh_degree, config.device)
        self.step, self.seconds = 0, 0.0
        self._history: list[TrainProgress] = []
        self._sums = np.zeros(3)  # loss, PSNR and number of steps since the last report
        self._run = _run_digest(start, frames, config) if checkpoint is not None else ""
        if checkpoint is not None:
            self._restore(load_checkpoint(checkpoint, self._run))

    @property
    def share(self) -> float:
        """Part of the run that is done, 0 to 1."""
        by_time = 0.0 if self.config.minutes is None else self.seconds / (60.0 * self.config.minutes)
        return min(1.0, max(self.step / max(1, self.config.steps), by_time))

    @property
    def done(self) -> bool:
        """Whether no step is left."""
        return self.step >= self.config.steps or self.share >= 1.0

    def advance(self) -> TrainProgress | None:
        """Do one step and what falls due after it; return the report that did."""
        began = self._clock()
        share = self.share
        loss, error = self._descend(share)
        self._sums += loss, -10.0 * math.log10(max(error, 1e-12)), 1.0
        self.step += 1
        self._control_density(share)
        self.seconds += self._clock() - began
        report = None
        if self.step % self.config.report_steps == 0 and not self.done:
            every = self.config.evaluate_steps
            report = self._report(evaluate=every > 0 and self.step % every == 0)
        if self.step % self.config.checkpoint_steps == 0 and not self.done:
            self.save()
        return report

    def finished(self, progress: Callable[[TrainProgress], object] | None) -> Trained:
        """Return the result, with a last report where there is none of this step yet."""
        if not self._history or self._history[-1].step < self.step or self.step == 0:
            report = self._report(evaluate=True, aligned=True)
            self.save()
            if progress is not None:
                progress(report)
        cameras = (self._corrections.camera(index, frame.camera) for index, frame in enumerate(self._frames))
        return Trained(self.state.gaussians(), tuple(self._history), tuple(cameras))

    def save(self) -> None:
        """Write the checkpoint, where one is kept."""
        if self._checkpoint is None:
            return
        head = {
            "step": self.step,
            "seconds": self.seconds,
            "sums": self._sums.tolist(),
            "history": [report.as_dict() for report in self._history],
        }
        arrays = {**self.state.arrays(), **self._corrections.arrays()}
        save_checkpoint(self._checkpoint, Checkpoint(self._run, head, arrays))

    def _restore(self, saved: Checkpoint | None) -> None:
        if saved is None:
            return
        self.state = TrainState.from_arrays(saved.arrays, self.config.device)
        self._corrections.restore(saved.arrays)
        self.step, self.seconds = saved.head["step"], saved.head["seconds"]
        self._sums = np.array(saved.head["sums"])
        self._history = [TrainProgress.from_dict(report) for report in saved.head["history"]]

    def _descend(self, share: float) -> tuple[float, float]:
        """Look at one photograph and move the Gaussians it shows; return the loss and the mean squared error."""
        config, state = self.config, self.state
        index = self._frame_at(self.step)
        view = self._views.view(index, self._scale(share))
        camera = self._corrections.camera(index, view.camera)
        degree = min(config.sh_degree, int(share / config.sh_every) if config.sh_every > 0 else config.sh_degree)
        with_depth = view.inverse_depth is not None and config.depth_first > 0
        raster = self._rasterize(
            *(state.values[name] for name in PARAMETERS),
            camera,
            sh_degree=degree,
            outputs=("color", "inverse_depth") if with_depth else ("color",),
            threads=config.threads,
        )
        exposure = self._corrections.exposure(index)
        color = raster.color if exposure is None else raster.color * exposure[0].exp() + exposure[1]
        loss = photometric_loss(color, view.photo, config.dssim_weight, threads=config.threads)
        if with_depth:
            weight = depth_weight(share, config.depth_first, config.depth_last)
            loss = loss + weight * inverse_depth_loss(raster.inverse_depth, view.inverse_depth)
        loss.backward()
        if config.tile_error_floor > 0:
            quiet = quiet_pixels(color.detach(), view.photo, config.tile_error_floor)
            for image in (raster.color, raster.inverse_depth):
                if image is not None:
                    image.grad[quiet] = 0.0
        gradients = raster.seen_gradients()
        by_pose = None
        if config.refine_poses:
            means, quats = (state.values[name][gradients.ids] for name in ("means", "quats"))
            by_pose = pose_gradient(camera, means, quats, gradients.means, gradients.quats)
        self._corrections.step(index, exposure, by_pose)
        if (self.step + 1) % len(self._views) == 0:
            self._corrections.center()
        state.pull[gradients.ids] += gradients.screen_norm
        state.looks[gradients.ids] += (gradients.opacity_logits != 0).to(state.looks.dtype)
        sparse_adam(
            state,
            gradients.ids,
            {name: getattr(gradients, name) for name in PARAMETERS},
            self._rates(share, degree),
            beta2=config.beta2,
            threads=config.threads,
        )
        return float(loss.detach()), float(torch.nn.functional.mse_loss(color.detach(), view.photo))

    def _frame_at(self, step: int) -> int:
        """Every frame once in each round, each round in an order of its own."""
        number, place = divmod(step, len(self._views))
        return int(np.random.default_rng([self.config.seed, 0, number]).permutation(len(self._views))[place])

    def _scale(self, share: float) -> float:
        return [scale for start, scale in self.config.scales if start <= share][-1]

    def _rates(self, share: float, degree: int) -> dict[str, Tensor]:
        rates = self.config.rates
        fade = rates.last_share**share
        means = self._extent_m * rates.means * (rates.means_last / rates.means) ** share
        coefficients = SH_COUNTS[degree]
        numbers = {
            "means": [means] * 3,
            "quats": [rates.quats * fade] * 4,
            "log_scales": [rates.log_scales * fade] * 3,
            "opacity_logits": [rates.opacity_logits * fade],
            "sh": [rates.colors * fade] * 3 + [rates.directions * fade] * (3 * (coefficients - 1)),
        }
        return {name: torch.tensor(values, device=self.config.device) for name, values in numbers.items()}

    def _control_density(self, share: float) -> None:
        density = self.config.density
        if not density.first <= share <= density.last:
            return
        if density.every > 0 and self.step % density.every == 0:
            self.state, _ = control_density(self.state, density, self._extent_m)
        if density.reset_every > 0 and self.step % density.reset_every == 0:
            cut_opacities(self.state, density.reset_to)

    def _report(self, *, evaluate: bool, aligned: bool = False) -> TrainProgress:
        loss, psnr, count = self._sums
        held_out = None
        if evaluate and self._held_out:
            held_out = held_out_quality(
                self.state.gaussians(), self._held_out, aligned=aligned, threads=self.config.threads
            )
        report = TrainProgress(
            step=self.step,
            steps=self.config.steps,
            share=self.share,
            seconds=self.seconds,
            gaussians=len(self.state),
            scale=self._scale(self.share),
            loss=float(loss / count) if count else None,
            psnr=float(psnr / count) if count else None,
            held_out=held_out,
        )
        self._sums[:] = 0.0
        self._history.append(report)
        return report


def quiet_pixels(color: Tensor, photo: Tensor, floor: float) -> Tensor:
    """Return the mask (H, W) of tiles whose mean absolute error is below `floor`."""
    height, width, _ = color.shape
    error = (color - photo).abs().mean(dim=2)
    tiles = torch.nn.functional.avg_pool2d(error[None, None], TILE, ceil_mode=True, count_include_pad=False)[0, 0]
    return (tiles < floor).repeat_interleave(TILE, 0).repeat_interleave(TILE, 1)[:height, :width]


@contextmanager
def _one_torch_thread() -> Iterator[None]:
    """Keep torch's own operations on this thread: few are left, and the number of threads would change their sums."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _rasterizer(device: str) -> Callable[..., Any]:
    if device == "cuda":
        from pipeline.construct.training import gsplat_rasterizer

        return gsplat_rasterizer.rasterize_seen
    from pipeline.construct.training import rasterizer

    return rasterizer.rasterize_seen


def _run_digest(start: Gaussians, frames: Sequence[Frame], config: TrainConfig) -> str:
    """Return a hash of what a run's steps depend on; photographs count by name, size and camera."""
    digest = hashlib.sha256(config.model_dump_json(exclude=set(_SAME_RUN)).encode())
    for name in PARAMETERS:
        digest.update(getattr(start, name).tobytes())
    for frame in frames:
        digest.update(f"{frame.name} {frame.image_uri} {frame.camera.width}x{frame.camera.height}".encode())
        digest.update(frame.camera.K.tobytes() + frame.camera.world_to_camera.tobytes())
    return digest.hexdigest()
