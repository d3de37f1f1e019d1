"""Captures of generated apartments: what photographs, a depth camera and structure from motion would have kept of them.

    python examples/captured_apartments.py demo/scenes/apartment-* --output demo/captures

Each scene becomes a COLMAP project of its name, as `splatreasoner build --capture` takes it: photographs, depth with
the noise and holes of structured light, sparse points, and label and instance images of the truth. The questions of
all scenes go into one file. docs/tables.md builds them with and without the depth loss.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int32
from PIL import Image

from pipeline.construct.simulated.depth_sensor import structured_light
from pipeline.construct.simulated.feature_points import KnownFrame, feature_points
from pipeline.construct.simulated.procedural_frames import SEEN_ALPHA
from pipeline.geometry import rotations_to_quats
from pipeline.render import color_image, prepare, render
from pipeline.scene import Scene
from pipeline.scene.captures import SparsePoints
from pipeline.scene.load import load_scene
from pipeline.scene.scene_file import OBJECTS, QUESTIONS
from pipeline.scene.views import View
from schemas.errors import InputError

NOTHING = 65535
"""Id in label and instance images that means: no label."""
MILLIMETRES = 1000.0
NO_ECHO = ("mirror", "window")
"""Categories whose depth is not measured: they send the projector's light elsewhere."""


def capture_scene(scene: Scene, folder: Path, rng: np.random.Generator, *, threads: int = 1) -> SparsePoints:
    """Write a scene's views as a COLMAP project and return its sparse points.

    Args:
        scene: A scene whose Gaussians have a category and an instance.
        folder: Where to; files of the same names are replaced.
        rng: Source of the sensors' noise.
        threads: Threads inside a frame.

    Raises:
        InputError: The scene has no categories or instances.
    """
    names, category, instance = scene.semantics.vocabulary, scene.semantics.category, scene.semantics.instance
    if category is None or instance is None:
        raise InputError(f"scene {scene.name}", field="semantics", expected="categories and instances", found="none")
    for part in ("images", "depth", "labels", "sparse/0"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    echoless = [number for number, name in enumerate(names) if name in NO_ECHO]
    prepared, frames = prepare(scene.gaussians), []
    for view in scene.views:
        rendering = render(prepared, view.camera, threads=threads)
        assert rendering.depth is not None, "every output was asked for"
        assert rendering.alpha is not None, "every output was asked for"
        assert rendering.dominant is not None, "every output was asked for"
        solid = rendering.alpha >= SEEN_ALPHA
        frame = KnownFrame(color_image(rendering), np.where(solid, rendering.depth, np.float32(0)), view.camera)
        label, thing = (_ids(of, rendering.dominant, solid) for of in (category, instance))
        depth = structured_light(frame.depth_m, view.camera, rng, np.isin(label, echoless))
        Image.fromarray(frame.photo).save(folder / f"images/{view.name}.png")
        _save_16_bit(depth * MILLIMETRES, folder / f"depth/{view.name}.png")
        _save_16_bit(label, folder / f"labels/{view.name}.label.png")
        _save_16_bit(thing, folder / f"labels/{view.name}.instance.png")
        frames.append(frame)
    (folder / "labels/names.json").write_text(json.dumps(list(names), indent=1))
    points = feature_points(frames, rng)
    _write_model(scene.views, points, folder / "sparse/0")
    return points


def _ids(
    of: Int32[np.ndarray, "M"], dominant: Int32[np.ndarray, "H W"], solid: Bool[np.ndarray, "H W"]
) -> Int32[np.ndarray, "H W"]:
    """Return each pixel's id, that of its dominant Gaussian."""
    ids = np.where(solid, of[dominant], -1)
    return np.where(ids < 0, NOTHING, ids).astype(np.int32)


def _save_16_bit(values: np.ndarray, path: Path) -> None:
    Image.fromarray(np.rint(values).astype(np.uint16)).save(path)


def _write_model(views: tuple[View, ...], points: SparsePoints, folder: Path) -> None:
    """Write COLMAP's text files, a camera for each image and no tracks."""
    cameras, images = [], []
    for number, view in enumerate(views, start=1):
        camera, pose = view.camera, view.camera.world_to_camera
        lens = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
        cameras.append(f"{number} PINHOLE {camera.width} {camera.height} {_numbers(lens)}\n")
        place = [*rotations_to_quats(pose[None, :, :3])[0], *pose[:, 3]]
        images.append(f"{number} {_numbers(place)} {number} {view.name}.png\n\n")
    rows = zip(points.positions, points.colors, strict=True)
    (folder / "cameras.txt").write_text("".join(cameras))
    (folder / "images.txt").write_text("".join(images))
    (folder / "points3D.txt").write_text(
        "".join(f"{i} {_numbers(at)} {r} {g} {b} 0\n" for i, (at, (r, g, b)) in enumerate(rows, start=1))
    )


def _numbers(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values))


def main() -> None:
    """Read the command line and write the captures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path, help="scene folders with categories and instances")
    parser.add_argument("--output", required=True, type=Path, help="folder of the captures")
    parser.add_argument("--seed", default=0, type=int, help="of the sensors' noise")
    parser.add_argument("--threads", default=2, type=int, help="threads inside a frame")
    asked = parser.parse_args()
    questions = []
    for folder in sorted(filter(Path.is_dir, asked.scenes)):
        scene = load_scene(str(folder))
        capture = asked.output / scene.name
        points = capture_scene(scene, capture, np.random.default_rng(asked.seed), threads=asked.threads)
        shutil.copyfile(folder / OBJECTS, capture / "labels" / OBJECTS)
        questions.append((folder / QUESTIONS).read_text())
        print(f"{capture}: {len(scene.views)} frames, {len(points.positions):,} sparse points")
    (asked.output / QUESTIONS).write_text("".join(questions))


if __name__ == "__main__":
    main()
