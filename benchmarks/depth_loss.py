"""What the depth loss does to built scenes, by the scenes their captures were rendered from.

    python -m benchmarks.depth_loss --truth demo/true demo/depth-loss/without/scenes demo/depth-loss/with/scenes

Renders of each folder's scenes are compared with renders of the true scenes of the same names: at every tenth view,
which builds keep from fitting by default, and at the novel poses that a job would take around it (free space, and what
the view looks at, by the true scene). docs/tables.md says how the scenes are made.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.geometry import Camera
from pipeline.metrics.image_quality import depth_errors, psnr
from pipeline.query.perturb import NovelViewConfig, novel_poses
from pipeline.render import PreparedGaussians, category_image, color_image, prepare, render
from pipeline.scene import Scene
from pipeline.scene.load import load_scene

HELD_OUT = 10
POSES = ("held out", "novel")
MEASURES = ("PSNR dB", "depth cm", "median cm", "within 5 cm", "category")


def poses(scene: Scene, prepared: PreparedGaussians, kind: str) -> Iterator[Camera]:
    for view in scene.views[HELD_OUT - 1 :: HELD_OUT]:
        if kind == "held out":
            yield view.camera
            continue
        depth = render(prepared, view.camera, ("depth",)).depth
        assert depth is not None
        local = view.camera.unproject(depth)[view.camera.height // 2, view.camera.width // 2]
        pose = view.camera.camera_to_world
        target = pose[:, :3] @ local + pose[:, 3]
        yield from (novel.camera for novel in novel_poses(prepared, view.camera, target, scene.up, NovelViewConfig()))


def compare(
    built: Scene, prepared: PreparedGaussians, truth: Scene, true: PreparedGaussians, camera: Camera
) -> tuple[float, ...]:
    seen, expected = render(prepared, camera), render(true, camera)
    assert seen.depth is not None
    assert expected.depth is not None
    depth = depth_errors(seen.depth, expected.depth)
    names = []
    for scene, rendering in ((built, seen), (truth, expected)):
        assert rendering.dominant is not None
        assert scene.semantics.category is not None
        words = np.array([*scene.semantics.vocabulary, ""])
        names.append(words[category_image(rendering.dominant, scene.semantics.category)])
    same = (names[0] == names[1])[names[1] != ""].mean()
    quality = psnr(color_image(seen), color_image(expected))
    return quality, 100 * depth.mean_abs_m, 100 * depth.median_abs_m, depth.within_5cm * depth.covered, float(same)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="folders of built scenes")
    parser.add_argument("--truth", required=True, type=Path, help="folder of the true scenes")
    asked = parser.parse_args()
    print(f"{'scenes':40} {'poses':9} {'count':>5} " + " ".join(f"{name:>11}" for name in MEASURES))
    for folder in asked.folders:
        rows: dict[str, list[tuple[float, ...]]] = {kind: [] for kind in POSES}
        for place in sorted(folder.iterdir()):
            built, truth = load_scene(str(place)), load_scene(str(asked.truth / place.name))
            prepared, true = prepare(built.gaussians), prepare(truth.gaussians)
            for kind in POSES:
                rows[kind] += [compare(built, prepared, truth, true, camera) for camera in poses(truth, true, kind)]
        for kind, found in rows.items():
            means = " ".join(f"{value:11.3f}" for value in np.mean(found, axis=0))
            print(f"{str(folder)[-40:]:40} {kind:9} {len(found):5} {means}", flush=True)


if __name__ == "__main__":
    main()
