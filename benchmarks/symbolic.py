"""Calls a minute of the symbolic model by stage, on two cores: pictures never seen, seen before, and as in a run.

    python -m benchmarks.symbolic [SCENE] [--questions 40]

Questions of a generated apartment (320 x 240, the demo's size) are taken through the method once and every request to
a model is kept; captions of the same pictures are added. Then one process a core answers the same requests and its CPU
time is taken. cold: a model that has seen nothing is made for every call. warm: all pictures were seen, and none was
asked the same before. run: one model answers in the order of the run, so that some pictures are new and the stages that
compare views ask again what was asked of each. The SHA-256 by which a picture is known is made once by whoever asks for
it first; in a run that is the key of the call, so it has a line of its own and is in no column. Every answer must be
that of a model that sees by the slow NumPy reference of the tests. Exits with 1 where an answer differs, or where a
rate of warm or run misses the target.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from benchmarks.apartments import apartment
from pipeline.config import MethodConfig
from pipeline.models.caller import Caller
from pipeline.models.config import STAGES
from pipeline.models.messages import ImagePart, Message, Reply, Request
from pipeline.models.prompts import Prompts
from pipeline.models.symbolic import SymbolicModel, sight
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from pipeline.tasks.method import decide, find_evidence, propose
from schemas.question_file import load_questions
from tests.models.symbolic_reference import perceive as reference

TARGET_PER_MIN = 200_000
WAYS = ("cold", "warm", "run")
CORES = 2
DESIGNS = ("text", "image", "image_text")
KEPT = 10_000
"""Views kept while the warm rate is taken: all."""


class Recorder(SymbolicModel):
    """The symbolic model, which keeps what it was asked."""

    def __init__(self) -> None:
        super().__init__()
        self.requests: list[Request] = []

    async def complete(self, request: Request) -> Reply:
        """Return the reply."""
        self.requests.append(request)
        return await super().complete(request)


class Measured(NamedTuple):
    """CPU seconds a call by name of the stage."""

    cold: dict[str, float]
    warm: dict[str, float]
    run: dict[str, float]
    wrong: int
    """Answers that differ from the reference."""
    digest_s: float
    """CPU seconds of a picture's SHA-256."""


def record(folder: str, count: int) -> list[Request]:
    """Return the requests of a scene's questions, with one caption for every picture."""
    context, model = SceneContext(load_scene(folder)), Recorder()
    caller = Caller(dict.fromkeys(STAGES, model), Prompts.load(), None)
    configs = [MethodConfig.model_validate({"judging": {"design": design}}) for design in DESIGNS]
    questions = load_questions(str(Path(folder, "questions.jsonl")))
    for at in np.linspace(0, len(questions) - 1, count).astype(int):
        evidence = asyncio.run(find_evidence(questions[at], context.vocabulary, caller, configs[0]))
        proposal = propose(context, questions[at], evidence, configs[0])
        for config in configs:
            asyncio.run(decide(questions[at], proposal, caller, config))
    pictures = {id(image): image for request in model.requests for image in request.images()}
    captions = [Request("caption", (Message("user", (image,)),)) for image in pictures.values()]
    return [*model.requests, *captions]


def measure(folder: str, count: int) -> Measured:
    """Return what the calls cost in this process."""
    requests = record(folder, count)
    expected = slow_answers(requests)
    answers: list[list[str]] = []
    seen = SymbolicModel(KEPT)

    def ready(request: Request) -> SymbolicModel:
        for image in request.images():
            seen.sight.view(image).answers.clear()
        return seen

    fresh = SymbolicModel(KEPT)
    ways: list[Callable[[Request], SymbolicModel]] = [lambda _: SymbolicModel(), ready, lambda _: fresh]
    costs: list[dict[str, float]] = []
    for model_of in ways:
        replies, cost = timed(requests, model_of)
        answers.append(replies)
        costs.append(cost)
    wrong = sum(ours != theirs for replies in answers for ours, theirs in zip(replies, expected, strict=True))
    return Measured(costs[0], costs[1], costs[2], wrong, digest_s(requests))


def digest_s(requests: Sequence[Request]) -> float:
    """Return the mean CPU seconds of a picture's SHA-256."""
    pictures = [ImagePart(image.color, image.observation) for request in requests for image in request.images()]
    start = time.process_time()
    for picture in pictures:
        picture.sha256()
    return (time.process_time() - start) / len(pictures)


def timed(
    requests: Sequence[Request], model_of: Callable[[Request], SymbolicModel]
) -> tuple[list[str], dict[str, float]]:
    """Return replies and mean CPU seconds by stage; what makes the model ready for a call is not counted."""
    spent: dict[str, list[float]] = defaultdict(list)
    replies = []
    for request in requests:
        model = model_of(request)
        start = time.process_time()
        replies.append(answer(model, request))
        spent[named(request)].append(time.process_time() - start)
    return replies, {stage: float(np.mean(seconds)) for stage, seconds in spent.items()}


def slow_answers(requests: Sequence[Request]) -> list[str]:
    """Return the replies of a model that perceives by the reference."""
    model = SymbolicModel(KEPT)
    with patch.object(sight, "perceive", reference):
        return [answer(model, request) for request in requests]


def answer(model: SymbolicModel, request: Request) -> str:
    """Return a reply without an event loop: the model never waits."""
    try:
        model.complete(request).send(None)
    except StopIteration as done:
        return str(done.value.text)
    raise AssertionError("the symbolic model waited")


def named(request: Request) -> str:
    """Return the stage, and how a choice is made."""
    return f"choice, {request.variables.get('design', 'text')}" if request.stage == "choice" else request.stage


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", help="scene folder with questions.jsonl")
    parser.add_argument("--questions", type=int, default=40)
    args = parser.parse_args()
    folder = args.scene or str(apartment(gaussians=80_000, views=120, rooms=4, width=320, height=240))
    measure(folder, 1)  # kernels are compiled and on disk before the processes start
    with ProcessPoolExecutor(CORES, get_context("spawn")) as pool:
        found = list(pool.map(measure, [folder] * CORES, [args.questions] * CORES))
    print(f"{'thousand calls a minute':22} {'cold':>8} {'warm':>8} {'run':>8}   ms a call, cold, warm, run")
    slow = []
    for stage in sorted(found[0].warm):
        costs = {way: [getattr(one, way)[stage] for one in found] for way in WAYS}
        rates = {way: sum(60.0 / seconds for seconds in cost) for way, cost in costs.items()}
        thousands = (f"{rate / 1e3:8,.0f}" for rate in rates.values())
        print(f"{stage:22}", *thousands, "  ", *(f"{1e3 * np.mean(cost):.3f}" for cost in costs.values()))
        slow += [f"{stage} ({way})" for way in ("warm", "run") if rates[way] < TARGET_PER_MIN]
    wrong = sum(one.wrong for one in found)
    print(f"SHA-256 of a picture, once: {1e3 * np.mean([one.digest_s for one in found]):.3f} ms")
    print(f"answers unlike the reference's: {wrong}; under {TARGET_PER_MIN:,} a minute: {', '.join(slow) or 'none'}")
    sys.exit(bool(wrong or slow))


if __name__ == "__main__":
    main()
