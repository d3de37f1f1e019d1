"""What a job will ask of its models, before anything is spent: calls, tokens, money and time by stage.

Questions are drawn from every task and scene and answered here, the models' part by the offline symbolic model. So
clusters, views and prompts are those of the run; replies are a stand-in: a real model may write longer ones and agree
with itself more or less often, which changes how many calls the exact savings spare. Stored replies are not looked at:
what is in the cache already costs less. Rows of the visibility index that are rendered here are stored for the run.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jobs.config import JobConfig
from jobs.plan import plan_units
from jobs.progress import Progress, Silent
from pipeline.models.caller import Caller
from pipeline.models.config import STAGES, EndpointConfig
from pipeline.models.estimate import likely_prompt_tokens, likely_text_tokens
from pipeline.models.messages import Reply, Request, Stage
from pipeline.models.prompts import Prompts
from pipeline.models.symbolic import SymbolicModel
from schemas.errors import QuestionError
from schemas.plan import PlannedUnit
from schemas.questions import Question
from workers.method_steps import METHOD_STEPS
from workers.steps import Steps

SECONDS_A_CALL = 2.0
"""Latency taken where nobody knows better: hosted vision models answer short questions in one to three seconds."""


@dataclass(frozen=True, slots=True)
class StageForecast:
    """What a stage will ask."""

    stage: str
    """Stage, as prompts name it."""
    endpoint: str
    """Who answers it."""
    calls: float
    """Calls."""
    prompt_tokens: float
    """Tokens in."""
    completion_tokens: float
    """Tokens out."""
    usd: float | None
    """Price, US dollars; None where the endpoint gives none, 0 where nothing is sent."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """What a job will take."""

    units: int
    """Units of work."""
    scenes: int
    """Scenes."""
    questions: int
    """Questions."""
    sampled: int
    """Questions that were tried."""
    stages: tuple[StageForecast, ...]
    """By stage, in the order of the prompts; those that ask nothing are left out."""
    cpu_s: float
    """CPU seconds of all questions, without the models."""
    model_s: Mapping[str, float]
    """By endpoint that is asked over a network, the seconds its limits and latency make of all its calls."""


class _CountingModel:
    """The symbolic model in the place of an endpoint, counting what that would be sent."""

    def __init__(self, name: str, endpoint: EndpointConfig) -> None:
        self._name, self._endpoint = name, endpoint
        self._symbolic = SymbolicModel()
        self.counts: dict[Stage, defaultdict[str, float]] = {}

    @property
    def name(self) -> str:
        return f"{self._name}:{self._endpoint.model}"

    def identity(self) -> Mapping[str, Any]:
        return self._endpoint.identity()

    async def complete(self, request: Request) -> Reply:
        reply = await self._symbolic.complete(request)
        count = self.counts.setdefault(request.stage, defaultdict(float))
        count["calls"] += 1
        count["prompt"] += likely_prompt_tokens(request, self._endpoint.image_tokens)
        count["completion"] += max(1.0, likely_text_tokens(reply.text))
        return reply


def forecast(
    config: JobConfig,
    *,
    subject: object = "job",
    sample: int = 60,
    cpus: int = 1,
    seconds_a_call: float = SECONDS_A_CALL,
    steps: Steps = METHOD_STEPS,
    progress: Progress | None = None,
) -> Forecast:
    """Return what a job will take, by trying some of its questions with no model asked.

    Args:
        config: The job.
        subject: What messages call it, such as its file.
        sample: Questions to try; all are tried where there are fewer.
        cpus: CPU slots the run will have.
        seconds_a_call: Latency to reckon with.
        steps: The method.
        progress: Who is told how it goes.

    Raises:
        InputError: The job, a scene or a question file is wrong.
    """
    units, shown = plan_units(config.model_copy(update={"cache": "replay"}), subject), progress or Silent()
    questions = [(unit, question) for unit in units for question in unit.questions]
    models = {name: _CountingModel(name, endpoint) for name, endpoint in config.models.endpoints.items()}
    clients = {stage: models[config.models.endpoint_of(stage)] for stage in STAGES}
    caller = Caller(clients, Prompts.load(config.models.prompts), None, max_asks=config.models.max_asks)
    chosen = _chosen(questions, sample)
    shown.begin(len(chosen), 0)
    sums: dict[Stage, defaultdict[str, float]] = {stage: defaultdict(float) for stage in STAGES}
    cpu_s = 0.0
    whole, part = Counter(q.task for _, q in questions), Counter(q.task for _, q in chosen)
    for scene, asked in _by_scene(chosen):
        answer = _Trial(config, steps, scene, caller)
        for question in asked:
            for model in models.values():
                model.counts.clear()
            start = time.thread_time()
            asyncio.run(answer.of(question))
            weight = whole[question.task] / part[question.task]
            cpu_s += (time.thread_time() - start) * weight
            for model in models.values():
                for stage, count in model.counts.items():
                    for name, value in count.items():
                        sums[stage][name] += value * weight
            shown.advance("")
    stages = tuple(_stage(config, stage, sums[stage]) for stage in STAGES if sums[stage]["calls"])
    model_s = {name: _seconds(config, name, stages, seconds_a_call) for name in config.models.remote_endpoints()}
    scenes = len({unit.scene_uri for unit in units})
    return Forecast(len(units), scenes, len(questions), len(chosen), stages, cpu_s / cpus, model_s)


class _Trial:
    """Questions of one scene, tried one after the other."""

    def __init__(self, config: JobConfig, steps: Steps, unit: PlannedUnit, caller: Caller) -> None:
        self._steps, self._method, self._caller = steps, config.method, caller
        scene = steps.load(unit.scene_uri)
        self._context, self._vocabulary = steps.open_context(scene, None), steps.vocabulary(scene)
        found = steps.read_index(scene, self._method, config.visibility_folder())
        steps.adopt_rows(self._context, self._method, found.rows)
        self._unstored = found.unstored

    async def of(self, question: Question) -> None:
        """Put a question through the steps that lead to calls; one that fails asks what it asked until then."""
        steps, method = self._steps, self._method
        try:
            evidence = await steps.find_evidence(question, self._vocabulary, self._caller, method)
            proposal = steps.propose(self._context, question, evidence, method)
            steps.keep_rows(self._context, method, self._unstored)
            await steps.decide(question, proposal, self._caller, method)
        except QuestionError:
            return


def _chosen(questions: Sequence[tuple[PlannedUnit, Question]], sample: int) -> list[tuple[PlannedUnit, Question]]:
    """Take questions at even steps through each task, so that every scene and kind has its share."""
    tasks: dict[str, list[tuple[PlannedUnit, Question]]] = defaultdict(list)
    for unit, question in questions:
        tasks[question.task].append((unit, question))
    chosen = []
    for found in tasks.values():
        count = min(len(found), max(1, round(sample * len(found) / len(questions))))
        chosen += [found[(2 * place + 1) * len(found) // (2 * count)] for place in range(count)]
    return chosen


def _by_scene(chosen: Sequence[tuple[PlannedUnit, Question]]) -> Iterator[tuple[PlannedUnit, list[Question]]]:
    scenes: dict[str, list[tuple[PlannedUnit, Question]]] = defaultdict(list)
    for unit, question in chosen:
        scenes[unit.scene_uri].append((unit, question))
    for found in scenes.values():
        yield found[0][0], [question for _, question in found]


def _stage(config: JobConfig, stage: Stage, sums: Mapping[str, float]) -> StageForecast:
    name = config.models.endpoint_of(stage)
    endpoint = config.models.endpoints[name]
    tokens = sums["prompt"], sums["completion"]
    usd = 0.0 if endpoint.kind == "symbolic" else None
    if endpoint.price is not None:
        usd = (tokens[0] * endpoint.price.prompt + tokens[1] * endpoint.price.completion) * 1e-6
    return StageForecast(stage, name, sums["calls"], *tokens, usd)


def _seconds(config: JobConfig, name: str, stages: Sequence[StageForecast], seconds_a_call: float) -> float:
    """The slowest of an endpoint's bounds: calls under way, requests and tokens per minute."""
    endpoint = config.models.endpoints[name]
    mine = [stage for stage in stages if stage.endpoint == name]
    calls = sum(stage.calls for stage in mine)
    tokens = sum(stage.prompt_tokens + stage.completion_tokens for stage in mine)
    bounds = [calls * seconds_a_call / endpoint.concurrency]
    if endpoint.requests_per_min is not None:
        bounds.append(calls / endpoint.requests_per_min * 60)
    if endpoint.tokens_per_min is not None:
        bounds.append(tokens / endpoint.tokens_per_min * 60)
    return max(bounds)
