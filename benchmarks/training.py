"""What training buys a capture: quality on held-out frames against time, for settings side by side.

    python -m benchmarks.training CAPTURE [--variants default no-depth registered points] [--cpu-seconds 60 180 600]
    python -m benchmarks.training --procedural [--variants default points] [--steps 0 200 1000]
    python -m benchmarks.training CAPTURE --parts

Every fifth frame is held out; all else is fused and fitted. Each budget is a run of its own, since schedules follow
it; CPU seconds are the whole process's and stand other work on the machine. Three figures of PSNR: at the recorded
poses; at poses fitted to the scene, since photographs that are out of step with their poses cap what any scene can
reach; and there with a gain and an offset per channel, since a camera sets its own exposure. `--procedural` takes a
generated apartment, whose poses, exposures and held-out depth are exact, and a depth camera's noise for the others.
`--parts` tells what a step is made of, per image scale.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from pipeline.construct.fusion.fuse import fuse
from pipeline.construct.fusion.fuse_config import FusionConfig
from pipeline.construct.fusion.sparse_start import start_from_points
from pipeline.construct.photos.register_photos import register_photos
from pipeline.construct.simulated.depth_sensor import structured_light
from pipeline.construct.simulated.feature_points import KnownFrame, feature_points
from pipeline.construct.simulated.procedural_frames import rgbd_frames
from pipeline.construct.training.depth_warp import inverse_depth_in
from pipeline.construct.training.losses import inverse_depth_loss, photometric_loss, torch_ssim
from pipeline.construct.training.rasterizer import rasterize_seen
from pipeline.construct.training.sparse_adam import sparse_adam
from pipeline.construct.training.train import train
from pipeline.construct.training.train_config import TrainConfig
from pipeline.construct.training.train_progress import TrainProgress, held_out_quality
from pipeline.construct.training.train_state import PARAMETERS, TrainState
from pipeline.construct.training.train_views import TrainViews
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame, open_capture
from pipeline.scene.procedural import build_apartment

THREEDGS_RATES = {
    "means": 1.6e-4, "means_last": 1.6e-6, "quats": 1e-3, "log_scales": 5e-3, "opacity_logits": 0.05,
    "colors": 2.5e-3, "directions": 1.25e-4, "last_share": 1.0,
}  # fmt: skip
"""Made for 30,000 steps."""
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "no-depth": {"depth_first": 0.0},
    "registered": {"refine_poses": True},
    "registered-no-depth": {"refine_poses": True, "depth_first": 0.0},
    "registered-depth-0.01": {"refine_poses": True, "depth_last": 0.01},
    "registered-depth-1": {"refine_poses": True, "depth_last": 1.0},
    "photos": {"refine_poses": True, "exposure": True},
    "photos-no-depth": {"refine_poses": True, "exposure": True, "depth_first": 0.0},
    "points": {"depth_first": 0.0, "density": {"every": 50}},
    "points-as-they-are": {"depth_first": 0.0},
    "density": {"density": {"every": 100}},
    "reset": {"density": {"every": 100, "reset_every": 300}},
    "3dgs-rates": {"rates": THREEDGS_RATES},
    "full-scale": {"scales": [[0.0, 1.0]]},
    "half-scale": {"scales": [[0.0, 0.5]]},
    "exposure": {"exposure": True},
    "poses": {"refine_poses": True},
    "degree-0": {"sh_degree": 0},
    "degree-3": {"sh_degree": 3},
    "no-dssim": {"dssim_weight": 0.0},
    "floor": {"tile_error_floor": 0.02},
}
"""What differs from the defaults."""
REGISTERED = tuple(name for name in VARIANTS if name.startswith(("registered", "photos")))
"""Variants whose photographs are registered to the scene, which is then fused again, before anything is fitted."""
FROM_POINTS = ("points", "points-as-they-are")
"""Variants that start from sparse points."""
COLUMNS = (
    "variant", "steps", "Gaussians", "CPU s", "wall s", "PSNR recorded", "fitted pose", "and exposure",
    "SSIM recorded", "fitted pose", "depth error mm", "within 5 cm",
)  # fmt: skip


@dataclass(frozen=True)
class Held:
    """An image in memory."""

    pixels: np.ndarray

    def read(self) -> np.ndarray:
        """Return it."""
        return self.pixels


@dataclass
class Bench:
    """A capture, split, and the settings that all variants share."""

    fitted: Sequence[Frame]
    held_out: Sequence[Frame]
    fusion: FusionConfig
    exact: bool
    """Whether held-out poses and exposures are true, and need no fit."""

    def start(self, name: str) -> tuple[Gaussians, Sequence[Frame]]:
        """Return what a variant starts from, and the frames it fits."""
        if name in FROM_POINTS:
            points = feature_points([_known(frame) for frame in self.fitted], np.random.default_rng(0))
            return start_from_points(points, [frame.camera for frame in self.fitted]), self.fitted
        made, frames = fuse(self.fitted, self.fusion).gaussians, self.fitted
        if name in REGISTERED:
            frames = register_photos(made, frames, threads=self.fusion.threads).frames
            made = fuse(frames, self.fusion).gaussians
        return made, frames

    def show(self, name: str, gaussians: Gaussians, steps: int, cpu_s: float, wall_s: float) -> None:
        """Print a row of the table."""
        q = held_out_quality(gaussians, self.held_out, aligned=not self.exact, threads=self.fusion.threads)
        row = [name, f"{steps:,}", f"{len(gaussians):,}", f"{cpu_s:.0f}", f"{wall_s:.0f}", f"{q.psnr:.2f}"]
        row += ["" if value is None else f"{value:.2f}" for value in (q.aligned_psnr, q.exposed_psnr)]
        row += [f"{q.ssim:.3f}", "" if q.aligned_ssim is None else f"{q.aligned_ssim:.3f}"]
        row += ["", ""] if q.depth_abs_m is None else [f"{1e3 * q.depth_abs_m:.1f}", f"{q.depth_within_5cm:.1%}"]
        print("| " + " | ".join(row) + " |", flush=True)

    def run(self, name: str, budgets: Sequence[dict[str, Any]], along: int) -> None:
        """Print a variant's start, and what each budget makes of it."""
        cpu, wall = time.process_time(), time.perf_counter()
        start, frames = self.start(name)
        self.show(f"{name}: start", start, 0, time.process_time() - cpu, time.perf_counter() - wall)
        for budget in budgets:
            told = {"threads": self.fusion.threads, "report_steps": along or 1_000_000, "evaluate_steps": along}
            config = TrainConfig.model_validate({**told, **budget, **VARIANTS[name]})
            cpu, wall = time.process_time(), time.perf_counter()
            trained = train(
                start, frames, config, clock=time.process_time, progress=_tell, held_out=self.held_out if along else ()
            )
            spent = trained.history[-1]
            wall = time.perf_counter() - wall
            self.show(name, trained.gaussians, spent.step, spent.seconds, wall)


def _tell(report: TrainProgress) -> None:
    if report.held_out is not None and report.share < 1:
        print(
            f"  {report.step} steps, {report.seconds:.0f} CPU s: {report.held_out.psnr:.2f} dB as recorded", flush=True
        )


def _known(frame: Frame) -> KnownFrame:
    """Return the photograph with its depth in its own pixels."""
    inverse = inverse_depth_in(frame.read_depth(), frame.depth_lens, frame.camera)
    with np.errstate(divide="ignore"):
        depth_m = np.where(inverse > 0, 1.0 / inverse, 0.0).astype(np.float32)
    return KnownFrame(frame.read_image(), depth_m, frame.camera)


def apartment(seed: int, views: int) -> tuple[list[Frame], list[Frame]]:
    """Return frames of a generated apartment to fit, with a depth camera's noise, and others with true depth."""
    scene = build_apartment(seed, rooms=2, gaussians=120_000, views=views).scene
    rng, fitted, held_out = np.random.default_rng(seed), [], []
    for number, (view, (image, depth_m)) in enumerate(zip(scene.views, rgbd_frames(scene), strict=True)):
        frame = Frame(view.name, view.camera, Held(image), Held(depth_m))
        if number % 5 == 4:
            held_out.append(frame)
        else:
            fitted.append(replace(frame, depth=Held(structured_light(depth_m, view.camera, rng))))
    return fitted, held_out


def parts(start: Gaussians, frames: Sequence[Frame], threads: int) -> None:
    """Print CPU milliseconds of the parts of a step, and of SSIM by torch."""
    views = TrainViews(frames[:8], 10_000, with_depth=True)
    state = TrainState.of(start, 0)
    rates = {name: torch.full((value[0].numel(),), 1e-9) for name, value in state.values.items()}
    spent: dict[str, float] = {}

    def timed(part: str, work: Callable[[], Any]) -> Any:
        began = time.process_time()
        result = work()
        spent[part] = spent.get(part, 0.0) + 1e3 * (time.process_time() - began)
        return result

    for scale in (0.25, 0.5, 1.0):
        for turn in range(2):  # the first compiles
            spent.clear()
            for k in range(len(views)):
                view = timed("photo", lambda k=k, scale=scale: views.view(k, scale))
                values = [state.values[name] for name in PARAMETERS]
                raster = timed(
                    "forward",
                    lambda values=values, view=view: rasterize_seen(
                        *values, view.camera, outputs=("color", "inverse_depth"), threads=threads
                    ),
                )
                loss = timed("loss", lambda r=raster, v=view: photometric_loss(r.color, v.photo, threads=threads))
                timed("loss back", loss.backward)
                if view.inverse_depth is not None:
                    depth = timed(
                        "depth", lambda r=raster, v=view: inverse_depth_loss(r.inverse_depth, v.inverse_depth)
                    )
                    timed("depth back", depth.backward)
                found = timed("backward", raster.seen_gradients)
                gradients = {name: getattr(found, name) for name in PARAMETERS}
                timed("adam", lambda f=found, g=gradients: sparse_adam(state, f.ids, g, rates, threads=threads))
                if turn and k == 0:
                    leaf = raster.color.detach().requires_grad_()
                    timed("torch's SSIM, 1 of 8", lambda x=leaf, v=view: torch_ssim(x, v.photo).backward())
        each = {part: ms if "1 of" in part else ms / len(views) for part, ms in spent.items()}
        print(
            f"scale {scale}: " + ", ".join(f"{part} {ms:.0f}" for part, ms in each.items()) + " CPU ms a step",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", nargs="?", help="folder of a capture")
    parser.add_argument("--procedural", action="store_true", help="a generated apartment in place of a capture")
    parser.add_argument("--seed", type=int, default=1, help="of the apartment")
    parser.add_argument("--views", type=int, default=60, help="of the apartment")
    parser.add_argument("--variants", nargs="+", choices=sorted(VARIANTS), default=["default"])
    budget = parser.add_mutually_exclusive_group()
    budget.add_argument("--cpu-seconds", type=float, nargs="+", default=None, help="budgets of training")
    budget.add_argument("--steps", type=int, nargs="+", default=None)
    parser.add_argument("--along", type=int, default=0, help="steps between two looks during a run, as recorded")
    parser.add_argument("--every", type=int, default=1, help="of the held-out frames, look at one in so many")
    parser.add_argument("--voxel", type=float, default=None, help="voxel of the fusion, metres")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--parts", action="store_true", help="only take a step apart")
    args = parser.parse_args()
    if (args.capture is None) != args.procedural:
        parser.error("either a capture or --procedural")
    fusion = {"threads": args.threads} | ({} if args.voxel is None else {"voxel_m": args.voxel})
    if args.procedural:
        fitted, held_out = apartment(args.seed, args.views)
    else:
        frames = open_capture(args.capture).frames
        fitted = [frame for index, frame in enumerate(frames) if index % 5 != 4]
        held_out = list(frames[4::5])
    bench = Bench(fitted, held_out[:: args.every], FusionConfig.model_validate(fusion), args.procedural)
    if args.parts:
        parts(bench.start("default")[0], fitted, args.threads)
        return
    budgets: list[dict[str, Any]] = (
        [{"steps": 1_000_000, "minutes": seconds / 60.0} for seconds in args.cpu_seconds]
        if args.cpu_seconds
        else [{"steps": steps} for steps in args.steps or [TrainConfig().steps]]
    )
    print("| " + " | ".join(COLUMNS) + " |\n|---|" + "--:|" * (len(COLUMNS) - 1), flush=True)
    for name in args.variants:
        bench.run(name, budgets, args.along)


if __name__ == "__main__":
    main()
