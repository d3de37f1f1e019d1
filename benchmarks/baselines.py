"""All methods on the same generated apartments and questions, with the symbolic model: what each scores and takes.

    NUMBA_NUM_THREADS=2 python -m benchmarks.baselines [--scenes 3] [--every 2]

LLM-Match of the questions in words, 3D mIoU of those about one object; frames, calls and tokens a question, where a
reply that is stored costs nothing and the judge's are left out; CPU seconds a question without the models', the work of
a whole scene (index, pictures that are described) spread over its questions. The symbolic model is no language model:
the table says what each method's input can tell, not how well a model would answer. The language field gets features
that are perfect by category (`features: symbolic`).
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.apartments import apartment
from pipeline.baselines.config import (
    BlindConfig,
    CategoryFieldConfig,
    FrameCaptionsConfig,
    MemorySnapshotsConfig,
    MultiFrameConfig,
    SceneGraphConfig,
    SentenceFieldConfig,
    VoxelCaptionsConfig,
)
from pipeline.baselines.registry import answer_question
from pipeline.config import MethodConfig
from pipeline.metrics.llm_match import match_score
from pipeline.models.cache import CallCache
from pipeline.models.caller import Caller
from pipeline.models.config import STAGES, EndpointConfig
from pipeline.models.estimate import likely_prompt_tokens, likely_text_tokens
from pipeline.models.messages import Reply, Request
from pipeline.models.prompts import Prompts
from pipeline.models.symbolic import SymbolicModel
from pipeline.scene.load import load_scene
from pipeline.scene.scene import Scene
from pipeline.tasks.method import QuestionRows, SceneContext
from schemas.question_file import load_questions
from schemas.questions import Question

SEEDS = range(301, 307)
"""Seeds of the apartments: none that was looked at while rules were written or settings chosen."""
METHODS = (
    BlindConfig(),
    FrameCaptionsConfig(),
    SceneGraphConfig(),
    VoxelCaptionsConfig(),
    MultiFrameConfig(),
    MemorySnapshotsConfig(),
    CategoryFieldConfig(features="symbolic"),
    SentenceFieldConfig(features="symbolic"),
    MethodConfig(),
)


class Counting:
    """The symbolic model; what is sent to it is counted as an endpoint would."""

    def __init__(self) -> None:
        self._model, self._image_tokens = SymbolicModel(), EndpointConfig().image_tokens
        self.calls, self.tokens, self.cpu_s = 0, 0.0, 0.0

    @property
    def name(self) -> str:
        """Return the model's name."""
        return self._model.name

    def identity(self) -> Mapping[str, Any]:
        """Return what changes an answer."""
        return self._model.identity()

    async def complete(self, request: Request) -> Reply:
        """Return the reply."""
        start = time.process_time()
        reply = await self._model.complete(request)
        self.cpu_s += time.process_time() - start
        if request.stage != "judge":
            self.calls += 1
            self.tokens += likely_prompt_tokens(request, self._image_tokens) + likely_text_tokens(reply.text)
        return reply


@dataclass(frozen=True, slots=True)
class Taken:
    """One method on one scene."""

    rows: tuple[QuestionRows, ...]
    calls: int
    tokens: float
    cpu_s: float


async def answer(scene: Scene, questions: Sequence[Question], config: Any, folder: Path) -> Taken:
    """Return what a method answers and takes on a scene, from nothing."""
    model, start = Counting(), time.process_time()
    caller = Caller(dict.fromkeys(STAGES, model), Prompts.load(), CallCache(folder))
    context = SceneContext(scene)
    rows = [await answer_question(context, question, caller, config) for question in questions]
    await caller.aclose()
    return Taken(tuple(rows), model.calls, model.tokens, time.process_time() - start - model.cpu_s)


def line(kind: str, taken: Sequence[Taken]) -> str:
    """Return a method's line of the table: means over the questions of the tasks it does."""
    last = [rows.arms[-1] for one in taken for rows in one.rows]
    done = [arm for arm in last if not arm.reason.startswith(f"{kind} only ")]
    marks = [match_score(arm.mark) for arm in done if arm.mark is not None]
    ious = [arm.iou for arm in done if arm.iou is not None]
    answered = sum(arm.status == "answered" for arm in done)
    cells = (
        kind,
        f"{np.mean(marks):.1f}" if marks else "–",
        f"{100 * np.mean(ious):.1f}" if ious else "–",
        f"{answered} of {len(done)}",
        f"{np.mean([arm.frames for arm in done]):.1f}",
        f"{sum(one.calls for one in taken) / len(done):.1f}",
        f"{sum(one.tokens for one in taken) / len(done):,.0f}",
        f"{sum(one.cpu_s for one in taken) / len(done):.2f}",
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=3, choices=range(1, len(SEEDS) + 1))
    parser.add_argument("--every", type=int, default=2, help="every n-th question of a scene")
    parser.add_argument("--gaussians", type=int, default=60_000)
    parser.add_argument("--views", type=int, default=80)
    options = parser.parse_args()
    size = {"rooms": 4, "width": 320, "height": 240, "gaussians": options.gaussians, "views": options.views}
    folders = [apartment(seed=seed, **size) for seed in SEEDS[: options.scenes]]
    scenes = [load_scene(str(folder)) for folder in folders]
    asked = [
        [one for one in load_questions(folder / "questions.jsonl") if one.task != "ground_many"][:: options.every]
        for folder in folders
    ]
    # What numba compiles belongs to no method.
    warm = [asked[0][0], next(one for one in asked[0] if one.task == "ground_one")]
    with tempfile.TemporaryDirectory() as folder:
        for config in METHODS:
            asyncio.run(answer(scenes[0], warm, config, Path(folder, f"warm-{config.kind}")))
        print("| method | LLM-Match | 3D mIoU | answered | frames | calls | tokens | CPU s |")
        print("|---|---|---|---|---|---|---|---|")
        for config in METHODS:
            taken = [
                asyncio.run(answer(scene, questions, config, Path(folder, config.kind)))
                for scene, questions in zip(scenes, asked, strict=True)
            ]
            print(line(config.kind, taken), flush=True)


if __name__ == "__main__":
    main()
