"""Generated apartments for benchmarks, made once in a process of their own and kept in a folder."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDER = Path(os.environ.get("SPLATREASONER_BENCHMARKS", Path(tempfile.gettempdir(), "splatreasoner-benchmarks")))

MAKE = """
import sys
import dataclasses
import numpy as np
from pipeline.scene.procedural import build_apartment
from pipeline.scene.questions import generate_questions
from pipeline.scene.save import save_scene
from schemas.question_file import save_questions
from schemas.storage import join, name_of
output = sys.argv[1]
seed, rooms, gaussians, views, width, height = map(int, sys.argv[2:])
made = build_apartment(seed, rooms=rooms, gaussians=gaussians, views=views, width=width, height=height, sh_degree=0)
scene = dataclasses.replace(made.scene, name=name_of(output))
questions = generate_questions(scene.name, made.objects, made.rooms, np.random.default_rng(seed))
save_questions(questions, join(output, "questions.jsonl"))
save_scene(scene, output, made.objects)
"""


def apartment(
    *, gaussians: int, views: int, rooms: int = 6, seed: int = 11, width: int = 640, height: int = 480
) -> Path:
    """Return the folder of an apartment with questions and colours of degree 0, made where it is missing.

    In another process, so that making it costs the caller neither memory nor warm caches.
    """
    folder = FOLDER / f"apartment-{seed}-{rooms}-rooms-{gaussians}-{views}-views-{width}x{height}"
    if not (folder / "scene.json").exists():
        print(f"making {folder}", file=sys.stderr, flush=True)
        numbers = [str(value) for value in (seed, rooms, gaussians, views, width, height)]
        subprocess.run([sys.executable, "-c", MAKE, str(folder), *numbers], cwd=ROOT, check=True)
    return folder
