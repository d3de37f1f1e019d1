"""Copies of scenes whose Gaussians lie scattered about their surfaces: a stand-in for training without depth loss.

    python examples/noisy_scenes.py --output demo/noisy demo/scenes/apartment-*

Real figures for the paper's table on 3DGS quality take the same captures trained both ways.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
from pathlib import Path

import numpy as np

from pipeline.scene.load import load_objects, load_scene
from pipeline.scene.save import save_scene
from pipeline.scene.scene import Scene

QUESTIONS = "questions.jsonl"


def scattered(scene: Scene, metres: float, rng: np.random.Generator) -> Scene:
    """Return the scene with every Gaussian moved by a normal deviate.

    Args:
        scene: The scene.
        metres: Standard deviation along each axis.
        rng: Source of the moves.
    """
    means = scene.gaussians.means + rng.normal(0.0, metres, scene.gaussians.means.shape)
    return dataclasses.replace(scene, gaussians=dataclasses.replace(scene.gaussians, means=means.astype(np.float32)))


def main() -> None:
    """Read the command line and write the copies."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path, help="scene folders")
    parser.add_argument("--output", required=True, type=Path, help="folder of the copies")
    parser.add_argument("--metres", type=float, default=0.05, help="how far Gaussians are moved (deviation)")
    asked = parser.parse_args()
    for folder in filter(Path.is_dir, asked.scenes):
        copy = asked.output / folder.name
        scene = scattered(load_scene(str(folder)), asked.metres, np.random.default_rng(0))
        copy.mkdir(parents=True, exist_ok=True)
        if (folder / QUESTIONS).is_file():
            shutil.copyfile(folder / QUESTIONS, copy / QUESTIONS)
        save_scene(scene, str(copy), load_objects(str(folder)))
        print(f"{copy}: {len(scene.gaussians):,} Gaussians moved")


if __name__ == "__main__":
    main()
