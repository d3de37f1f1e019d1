"""The same frames for another trainer, and its Gaussians judged as ours are: on frames it never saw.

Run: python -m benchmarks.peer_training export CAPTURE FOLDER    frames to fit, as a nerfstudio folder with a start
     python -m benchmarks.peer_training score CAPTURE PLY ...    its Gaussians on the held-out frames

Every fifth frame is held out (index % 5 == 4). The start is the points that our own training starts from, so that
trainers differ in how they fit and not in what they are given. docs/building.md says how OpenSplat was run.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.construct.fusion.fuse import fuse
from pipeline.construct.fusion.fuse_config import FusionConfig
from pipeline.construct.training.train_progress import held_out_quality
from pipeline.geometry.pose import opengl_to_opencv
from pipeline.scene.captures import Frame, open_capture
from pipeline.scene.formats.read import load_gaussians

EVERY, HELD_OUT = 5, 4
"""Frames with index % EVERY == HELD_OUT are judged, the others fitted."""
VOXEL_M = 0.02
"""Spacing of the points to start from, metres."""
C0 = 0.28209479177387814
"""Factor of the constant spherical harmonic."""


def halves(capture: str) -> tuple[list[Frame], list[Frame]]:
    """Return the frames to fit and those held out."""
    frames = open_capture(capture).frames
    fitted = [frame for index, frame in enumerate(frames) if index % EVERY != HELD_OUT]
    return fitted, [frame for index, frame in enumerate(frames) if index % EVERY == HELD_OUT]


def export(capture: str, folder: Path) -> None:
    """Write photographs, transforms.json and points.ply."""
    fitted, _ = halves(capture)
    (folder / "images").mkdir(parents=True, exist_ok=True)
    entries = []
    for frame in fitted:
        file = f"images/{frame.name}.png"
        Image.fromarray(frame.read_image()).save(folder / file)
        camera = frame.camera
        pose = np.vstack([opengl_to_opencv(camera.camera_to_world), [0, 0, 0, 1]])  # its own inverse
        lens = {"fl_x": camera.K[0, 0], "fl_y": camera.K[1, 1], "cx": camera.K[0, 2], "cy": camera.K[1, 2]}
        size = {"w": camera.width, "h": camera.height}
        entries.append({"file_path": file, "transform_matrix": pose.tolist(), **size, **lens})
    start = fuse(fitted, FusionConfig(voxel_m=VOXEL_M)).gaussians
    colors = np.clip((start.sh[:, 0] * C0 + 0.5) * 255, 0, 255).astype(np.uint8)
    table = np.zeros(len(start), [(n, "<f4") for n in "xyz"] + [(n, "u1") for n in ("red", "green", "blue")])
    for axis, name in enumerate("xyz"):
        table[name] = start.means[:, axis]
    for channel, name in enumerate(("red", "green", "blue")):
        table[name] = colors[:, channel]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(start)}"]
    header += [f"property float {n}" for n in "xyz"] + [f"property uchar {n}" for n in ("red", "green", "blue")]
    (folder / "points.ply").write_bytes("\n".join([*header, "end_header", ""]).encode() + table.tobytes())
    transforms = {"camera_model": "OPENCV", "ply_file_path": "points.ply", "frames": entries}
    (folder / "transforms.json").write_text(json.dumps(transforms))
    print(f"{folder}: {len(entries)} frames, {len(start):,} points")


def score(capture: str, files: list[str]) -> None:
    """Print what each file's Gaussians show of the held-out frames: as `benchmarks/training.py` judges ours."""
    _, held_out = halves(capture)
    print(
        f"{'file':32} {'Gaussians':>9} {'PSNR':>6} {'SSIM':>6} {'fitted':>7} {'exposed':>8} {'depth':>8} {'in 5 cm':>8}"
    )
    for file in files:
        gaussians = load_gaussians(file)
        found = held_out_quality(gaussians, held_out, aligned=True, threads=2)
        depth = f"{100 * (found.depth_abs_m or np.nan):5.1f} cm {found.depth_within_5cm or np.nan:8.1%}"
        fitted = f"{found.aligned_psnr:7.2f} {found.exposed_psnr:8.2f}"
        print(f"{Path(file).name:32} {len(gaussians):9,} {found.psnr:6.2f} {found.ssim:6.3f} {fitted} {depth}")


def main() -> None:
    """Export or score."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("export", "score"))
    parser.add_argument("capture")
    parser.add_argument("paths", nargs="+")
    arguments = parser.parse_args()
    if arguments.what == "export":
        export(arguments.capture, Path(arguments.paths[0]))
    else:
        score(arguments.capture, arguments.paths)


if __name__ == "__main__":
    main()
