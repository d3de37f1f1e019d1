"""Milliseconds of a training frame, forward and back, beside the renderer's own frame; and the gradient's error.

    python -m benchmarks.backward                                   # 100,000 and 500,000 Gaussians, 640 x 480
    python -m benchmarks.backward --counts --capture FOLDER          # a capture's start by depth fusion, frame 0

Every figure is the median over repeats, in which the renderer's frame, the drawing and its gradients take turns, so
that a busy machine slows all three. With one thread they are CPU time, with more wall time. The loss pulls at colour,
alpha and inverse depth of every pixel at random. The error is that of a small scene's gradient against a dense PyTorch
renderer in float64: the largest difference, as a share of the largest gradient of its kind.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from benchmarks.render import print_machine, synthetic_room
from pipeline.geometry import Camera
from pipeline.render import prepare, render
from pipeline.render.backward import RawGaussians, draw
from pipeline.scene.gaussians import Gaussians

NAMES = RawGaussians.__slots__


def raw_of(scene: Gaussians) -> RawGaussians:
    return RawGaussians(*(np.array(getattr(scene, name)) for name in NAMES))


def fused_start(folder: Path) -> tuple[Gaussians, list[Camera]]:
    """Gaussians fused from a capture's depth, and its cameras."""
    from pipeline.construct.fusion.fuse import fuse
    from pipeline.scene.captures import open_capture

    frames = open_capture(folder).frames
    return fuse([f for k, f in enumerate(frames) if k % 5 != 4]).gaussians, [frame.camera for frame in frames]


def measure(name: str, scene: Gaussians, camera: Camera, threads: int, repeats: int) -> None:
    raw, prepared = raw_of(scene), prepare(scene)
    rng = np.random.default_rng(0)
    size = (camera.height, camera.width)
    pulls = [rng.normal(size=shape).astype(np.float32) for shape in ((*size, 3), size, size)]
    clock = time.thread_time if threads == 1 else time.perf_counter
    spent, phases = [], []
    for _ in range(repeats + 2):  # the first two compile and grow the buffers
        times = [clock()]
        render(prepared, camera, ("color", "alpha", "depth"), threads=threads)
        times.append(clock())
        drawing = draw(raw, camera, sh_degree=scene.sh_degree, inverse_depth=True, threads=threads, timed=True)
        times.append(clock())
        drawing.gradients(pulls[0], pulls[1], None, pulls[2])
        times.append(clock())
        phases.append(drawing.milliseconds)
        drawing.release()
        spent.append(np.diff(times) * 1e3)
    frame, forward, back = np.median(spent[2:], axis=0)
    print(
        f"{name:10} {len(scene):8} {len(drawing.ids):8} {threads:7} {frame:8.1f} {forward:8.1f} {back:8.1f}"
        f" {(forward + back) / frame:8.2f}   "
        + ", ".join(f"{k} {np.median([p[k] for p in phases[2:]]):.1f}" for k in phases[-1])
    )


def error_against_float64() -> None:
    """Largest differences of the gradients of 300 Gaussians on 96 x 72 pixels."""
    import torch

    from tests.construct.training.test_rasterizer import image_weights, our_gradients, true_gradients
    from tests.render.scenes import camera, random_scene

    scene, view = random_scene(0, 300, sh_degree=3), camera(96, 72)
    weights = image_weights(view)
    with torch.random.fork_rng():
        pairs = zip(NAMES, our_gradients(scene, view, weights), true_gradients(scene, view, weights), strict=True)
        errors = [f"{name} {np.abs(ours - true).max() / np.abs(true).max():.1e}" for name, ours, true in pairs]
    print("largest error against float64, by kind: " + ", ".join(errors))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", type=int, nargs="*", default=[100_000, 500_000], help="Gaussians of the room")
    parser.add_argument("--capture", type=Path, help="posed frames with depth; every fifth is left out, as in training")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeats", type=int, default=9)
    options = parser.parse_args()
    print_machine()
    scenes = [(f"room {count // 1000}k", *synthetic_room(count)) for count in options.counts]
    if options.capture:
        scenes.append((options.capture.name[:10], *fused_start(options.capture)))
    print(f"{'scene':10} Gaussians    seen threads   render  forward     back    ratio   phases, ms")
    for name, scene, cameras in scenes:
        for threads in options.threads:
            measure(name, scene, cameras[0], threads, options.repeats)
    error_against_float64()


if __name__ == "__main__":
    main()
