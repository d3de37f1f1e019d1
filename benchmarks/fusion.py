"""What depth fusion gives before any training: held-out images and depth, seconds and memory, by voxel size.

    python -m benchmarks.fusion [CAPTURE] [--voxels 0.02 0.01 0.0075] [--threads 2] [--every 5] [--pictures FOLDER]
    python -m benchmarks.fusion [CAPTURE] --variants        # what each part of the fusion is worth
    python -m benchmarks.fusion --procedural                # against the true Gaussians, with and without sensor noise
    python -m benchmarks.fusion --sparse                    # the start without depth: points as COLMAP would leave them

CAPTURE is any folder or file `open_capture` reads; the 7-Scenes kitchen in $SPLATREASONER_DATA (or ../shared/data) by
default. Every fifth frame is held out: fusion never sees it, and its photograph and depth are what renders are held
against. Photographs keep the exposure and the pose they were recorded with. Depth is compared in the depth image's own
camera. Seconds are CPU time of the process beside wall time, kernels compiled before.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.apartments import ROOT
from pipeline.construct.fusion.fuse import Fused, fuse
from pipeline.construct.fusion.fuse_config import FusionConfig
from pipeline.construct.fusion.sparse_start import start_from_points
from pipeline.construct.simulated.procedural_frames import rgbd_frames
from pipeline.metrics.image_quality import depth_errors, psnr, ssim
from pipeline.render import color_image, prepare, render
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame, SparsePoints, open_capture
from pipeline.scene.procedural import build_apartment

DATA = Path(os.environ.get("SPLATREASONER_DATA", ROOT.parent / "shared" / "data"))
SEEN_ALPHA = 0.5
"""Rendered depth counts where the Gaussians cover at least this much of a pixel."""
VARIANTS: dict[str, dict[str, object]] = {
    "default": {},
    "no fill": {"fill": False},
    "colours not fitted": {"color_rounds": 0},
    "colours fitted three times": {"color_rounds": 3},
    "one frame is enough": {"least_frames": 1},
    "three frames": {"least_frames": 3},
}
DEPTH_NOISE = 0.0015
"""Standard deviation of a structured-light camera's depth at 1 m, metres; it grows with the square."""


@dataclass(frozen=True)
class Held:
    """An image that is at hand."""

    pixels: np.ndarray

    def read(self) -> np.ndarray:
        """Return it."""
        return self.pixels


def quality(gaussians: Gaussians, frames: Sequence[Frame], threads: int, pictures: Path | None = None) -> str:
    """Return a table row of means over the frames; saves render and photograph side by side where asked to."""
    prepared, rows = prepare(gaussians), []
    for frame in frames:
        seen, image = render(prepared, frame.camera, ("color", "alpha"), threads=threads), frame.read_image()
        assert seen.color is not None
        assert seen.alpha is not None
        row = [psnr(seen.color, image), ssim(seen.color, image), float((seen.alpha < SEEN_ALPHA).mean())]
        if frame.depth is not None:
            lens = render(prepared, frame.depth_lens, ("depth", "alpha"), threads=threads)
            assert lens.depth is not None
            assert lens.alpha is not None
            depth_m = np.where(lens.alpha >= SEEN_ALPHA, lens.depth, np.float32(0))
            found = depth_errors(depth_m, frame.read_depth())
            row += [found.mean_abs_m, found.median_abs_m, found.rmse_m, found.mean_relative, found.within_5cm]
        rows.append(row)
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            pair = np.concatenate([color_image(seen), image], axis=1)
            Image.fromarray(pair).save(pictures / f"{frame.name}.png")
    means = np.nanmean(np.array(rows), axis=0)
    text = f"{len(gaussians):9,} | {means[0]:6.2f} | {means[1]:5.3f} | {means[2]:6.1%}"
    if len(means) > 3:
        text += f" | {means[3]:6.3f} | {means[4]:6.3f} | {means[5]:6.3f} | {means[6]:6.1%} | {means[7]:6.1%}"
    return text


HEAD = "| Gaussians | PSNR dB | SSIM | uncovered | depth mean | median | RMSE m | relative | in 5 cm | CPU s | wall s |"


def timed(frames: Sequence[Frame], config: FusionConfig) -> tuple[Fused, str]:
    """Return a fusion and its times as the end of a table row."""
    cpu, wall = time.process_time(), time.perf_counter()
    made = fuse(frames, config)
    return made, f"{time.process_time() - cpu:5.1f} | {time.perf_counter() - wall:5.1f} |"


def split_frames(frames: Sequence[Frame], every: int) -> tuple[list[Frame], list[Frame]]:
    """Return the frames to build from and those held out: the last of each `every`."""
    held = [i % every == every - 1 for i in range(len(frames))]
    return [f for f, h in zip(frames, held, strict=True) if not h], [f for f, h in zip(frames, held, strict=True) if h]


def procedural(seed: int, noise: float) -> tuple[Gaussians, list[Frame]]:
    """Return a small apartment and its RGB-D frames, with a structured-light camera's noise."""
    scene = build_apartment(seed, rooms=2, gaussians=120_000, views=100, sh_degree=0).scene
    rng, frames = np.random.default_rng(seed), []
    for view, (image, depth_m) in zip(scene.views, rgbd_frames(scene), strict=True):
        noisy = depth_m + noise * depth_m**2 * rng.standard_normal(depth_m.shape, np.float32)
        held = Held(np.where(depth_m > 0, noisy, np.float32(0)).astype(np.float32))
        frames.append(Frame(view.name, view.camera, Held(image), held))
    return scene.gaussians, frames


def surface_distance(made: Gaussians, true: Gaussians) -> str:
    """Return how far opaque Gaussians are from the nearest true one, and the other way round."""
    from scipy.spatial import cKDTree

    solid = true.means[true.opacity_logits > 0]
    to_true, _ = cKDTree(solid).query(made.means)
    to_made, _ = cKDTree(made.means).query(solid)
    return (
        f"to the nearest true Gaussian: median {np.median(to_true) * 100:.1f} cm, "
        f"95 % within {np.percentile(to_true, 95) * 100:.1f} cm; "
        f"true ones within 5 cm of ours: {(to_made < 0.05).mean():.1%} (the rest was not seen or lies inside)"
    )


def sparse_points(frames: Sequence[Frame], count: int, rng: np.random.Generator) -> SparsePoints:
    """Return points as structure from motion leaves them: at corners of the pictures, noisy, a few far off."""
    positions, colors = [], []
    for frame in frames:
        image, depth_m = frame.read_image(), frame.read_depth()
        grey = image.astype(np.float64).mean(axis=2)
        corner = np.hypot(*np.gradient(grey)) * (depth_m > 0) + 1e-6
        picked = rng.choice(corner.size, count // len(frames), replace=False, p=(corner / corner.sum()).ravel())
        pose = frame.camera.camera_to_world
        local = frame.camera.unproject(depth_m).reshape(-1, 3)[picked]
        local *= 1.0 + 0.005 * rng.standard_normal((len(picked), 1))
        wrong = rng.random(len(picked)) < 0.01
        local[wrong] *= rng.uniform(0.3, 4.0, (int(wrong.sum()), 1))
        positions.append(local @ pose[:, :3].T + pose[:, 3])
        colors.append(image.reshape(-1, 3)[picked])
    return SparsePoints(np.concatenate(positions), np.concatenate(colors))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", nargs="?", default=str(DATA / "kitchen_7scenes"))
    parser.add_argument("--voxels", type=float, nargs="+", default=[0.04, 0.02, 0.01, 0.0075])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--every", type=int, default=5, help="one frame in so many is held out")
    parser.add_argument("--pictures", type=Path, help="folder for renders beside photographs, of the last voxel size")
    parser.add_argument("--variants", action="store_true")
    parser.add_argument("--procedural", action="store_true")
    parser.add_argument("--sparse", action="store_true")
    args = parser.parse_args()
    threads = args.threads
    if args.sparse:
        _, frames = procedural(1, 0.0)
        built, held = split_frames(frames, args.every)
        points = sparse_points(built, 30_000, np.random.default_rng(0))
        start = start_from_points(points, [f.camera for f in built])
        print(f"{len(points.positions):,} points, {len(start):,} Gaussians\n| {quality(start, held, threads)} |")
        return
    if args.procedural:
        print("depth noise " + HEAD)
        for noise in (0.0, DEPTH_NOISE):
            true, frames = procedural(1, noise)
            built, held = split_frames(frames, args.every)
            exact = split_frames(procedural(1, 0.0)[1], args.every)[1] if noise else held
            fuse(built[:2], FusionConfig(threads=threads))
            made, seconds = timed(built, FusionConfig(voxel_m=0.02, threads=threads))
            print(f"| {noise} | {quality(made.gaussians, exact, threads, args.pictures)} | {seconds}")
            print("  " + surface_distance(made.gaussians, true))
        return
    built, held = split_frames(open_capture(args.capture).frames, args.every)
    fuse(built[:2], FusionConfig(threads=threads, least_frames=1))
    print(f"{len(built)} frames, {len(held)} held out\n| what {HEAD}")
    base = FusionConfig(threads=threads)
    named = (
        {name: base.model_copy(update=change) for name, change in VARIANTS.items()}
        if args.variants
        else {f"{voxel * 1000:g} mm": base.model_copy(update={"voxel_m": voxel}) for voxel in args.voxels}
    )
    for number, (name, config) in enumerate(named.items(), start=1):
        made, seconds = timed(built, config)
        pictures = args.pictures if number == len(named) else None
        print(f"| {name} | {quality(made.gaussians, held, threads, pictures)} | {seconds}", flush=True)


if __name__ == "__main__":
    main()
