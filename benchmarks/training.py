"""What training buys a capture: quality on held-out frames against time, for settings side by side.

    python -m benchmarks.training CAPTURE [--register 1] [--variants default no-depth] [--minutes 10 | --steps 1000]
    python -m benchmarks.training CAPTURE --parts

Every fifth frame is held out; all else is fused and fitted. CPU is the whole process's; on a machine that does other
work compare that, and take `--steps` instead of `--minutes`. Photographs that are out of step with the poses cap what
any scene can reach on held-out frames: each variant ends with a line where these are registered to the scene, by their
poses alone. `--parts` tells what a step is made of, per image scale.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from typing import Any

import torch

from pipeline.construct.fuse import fuse
from pipeline.construct.fuse_config import FusionConfig
from pipeline.construct.losses import inverse_depth_loss, photometric_loss, torch_ssim
from pipeline.construct.rasterizer import rasterize_seen
from pipeline.construct.register_photos import register_photos
from pipeline.construct.sparse_adam import sparse_adam
from pipeline.construct.train import train
from pipeline.construct.train_config import TrainConfig
from pipeline.construct.train_progress import TrainProgress, held_out_quality
from pipeline.construct.train_state import PARAMETERS, TrainState
from pipeline.construct.train_views import TrainViews
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame, open_capture

THREEDGS_RATES = {
    "means": 1.6e-4, "means_last": 1.6e-6, "quats": 1e-3, "log_scales": 5e-3, "opacity_logits": 0.05,
    "colors": 2.5e-3, "directions": 1.25e-4, "last_share": 1.0,
}  # fmt: skip
"""Made for 30,000 steps."""
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "no-depth": {"depth_first": 0.0},
    "density": {"density": {"every": 100}},
    "reset": {"density": {"every": 100, "reset_every": 300}},
    "3dgs-rates": {"rates": THREEDGS_RATES},
    "full-scale": {"scales": [[0.0, 1.0]]},
    "half-scale": {"scales": [[0.0, 0.5]]},
    "exposure": {"exposure": True},
    "poses": {"refine_poses": True},
    "photos": {"refine_poses": True, "exposure": True},
    "degree-0": {"sh_degree": 0},
    "degree-3": {"sh_degree": 3},
    "no-dssim": {"dssim_weight": 0.0},
    "floor": {"tile_error_floor": 0.02},
}
"""What differs from the defaults."""


def curve(name: str, start: Gaussians, fitted: Sequence[Frame], held_out: Sequence[Frame], config: TrainConfig) -> None:
    """Train once and print a line for every report that looked at held-out frames."""
    cpu = time.process_time()

    def tell(report: TrainProgress) -> None:
        if report.held_out is not None:
            show(name, report, time.process_time() - cpu)

    train(start, fitted, config, held_out=held_out, progress=tell)


def show(name: str, report: TrainProgress, cpu_s: float) -> None:
    quality = report.held_out
    assert quality is not None
    depth = (
        "" if quality.depth_abs_m is None else f"{1e3 * quality.depth_abs_m:5.0f} mm {quality.depth_within_5cm:6.1%}"
    )
    if quality.aligned_psnr is not None:
        depth += (
            f"; aligned {quality.aligned_psnr:.2f} dB {quality.aligned_ssim:.3f}, exposed {quality.exposed_psnr:.2f} dB"
        )
    print(
        f"{name:12s} {report.step:6d} steps {report.seconds:6.0f} s {cpu_s:6.0f} CPU s {report.gaussians:8,d} "
        f"{quality.psnr:6.2f} dB {quality.ssim:.3f} {depth}",
        flush=True,
    )


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
    parser.add_argument("capture", help="folder of a capture")
    parser.add_argument("--variants", nargs="+", choices=sorted(VARIANTS), default=["default"])
    parser.add_argument("--minutes", type=float, default=None)
    parser.add_argument("--steps", type=int, default=None)
    parser.add_argument("--every", type=int, default=200, help="steps between two looks at held-out frames")
    parser.add_argument("--voxel", type=float, default=None, help="voxel of the fusion, metres")
    parser.add_argument("--register", type=int, default=0, help="times photographs are registered and fused again")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--parts", action="store_true", help="only take a step apart")
    args = parser.parse_args()
    frames = open_capture(args.capture).frames
    held_out = frames[4::5]
    fitted: Sequence[Frame] = [frame for index, frame in enumerate(frames) if index % 5 != 4]
    fusion = {"threads": args.threads} | ({} if args.voxel is None else {"voxel_m": args.voxel})
    began, cpu = time.perf_counter(), time.process_time()
    start = fuse(fitted, FusionConfig.model_validate(fusion)).gaussians
    for _ in range(args.register):
        fitted = register_photos(start, fitted, threads=args.threads).frames
        start = fuse(fitted, FusionConfig.model_validate(fusion)).gaussians
    print(
        f"fused: {time.perf_counter() - began:.0f} s, {time.process_time() - cpu:.0f} CPU s, {len(start):,} Gaussians"
    )
    if args.parts:
        parts(start, fitted, args.threads)
        return
    quality = held_out_quality(start, held_out, aligned=True, threads=args.threads)
    show("start", TrainProgress(0, 0, 0.0, 0.0, len(start), 1.0, None, None, quality), 0.0)
    for name in args.variants:
        told = {"threads": args.threads, "evaluate_steps": args.every, "report_steps": args.every}
        told |= {"steps": args.steps} if args.steps else {"steps": 1_000_000} if args.minutes else {}
        told |= {"minutes": args.minutes} if args.minutes else {}
        curve(name, start, fitted, held_out, TrainConfig.model_validate({**told, **VARIANTS[name]}))


if __name__ == "__main__":
    main()
