"""The same frames for another trainer, and its Gaussians judged as ours are: on frames it never saw.

Run: python -m benchmarks.peer_training export CAPTURE FOLDER    frames to fit, as a nerfstudio folder with a start
     python -m benchmarks.peer_training score CAPTURE PLY ...    PSNR, SSIM and depth error on the held-out frames

Every fifth frame is held out (index % 5 == 4). The start is the points that our own training starts from, so that
trainers differ in how they fit and not in what they are given. docs/building.md says how OpenSplat was run.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.construct.fuse import fuse
from pipeline.construct.fuse_config import FusionConfig
from pipeline.geometry.pose import opengl_to_opencv
from pipeline.metrics.image_quality import depth_errors, psnr, ssim
from pipeline.render import prepare, render
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
    """Print what each file's Gaussians show of the held-out frames."""
    _, held_out = halves(capture)
    print(f"{'file':40} {'Gaussians':>10} {'PSNR':>6} {'SSIM':>6} {'depth error':>12} {'within 5 cm':>12}")
    for file in files:
        gaussians = load_gaussians(file)
        prepared = prepare(gaussians)
        rows = []
        for frame in held_out:
            seen = render(prepared, frame.camera, outputs=("color",), threads=2).color
            depth = render(prepared, frame.depth_lens, outputs=("depth",), threads=2).depth
            errors = depth_errors(depth, frame.read_depth())
            image = frame.read_image()
            rows.append((psnr(seen, image), ssim(seen, image), errors.mean_abs_m, errors.within_5cm))
        values = np.nanmean(rows, axis=0)
        quality = f"{values[0]:6.2f} {values[1]:6.3f} {values[2] * 100:9.1f} cm {values[3]:12.1%}"
        print(f"{Path(file).name:40} {len(gaussians):10,} {quality}")


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
