"""Questions of a job tried before it runs.

The models' part is played by the symbolic model, and what an endpoint would be sent is counted.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jobs.config import JobConfig
from pipeline.models.caller import Caller
from pipeline.models.config import STAGES, EndpointConfig
from pipeline.models.estimate import likely_prompt_tokens, likely_text_tokens
from pipeline.models.messages import Reply, Request, Stage
from pipeline.models.prompts import Prompts
from pipeline.models.symbolic import SymbolicModel
from schemas.errors import InputError, QuestionError
from schemas.plan import PlannedUnit
from schemas.questions import Question
from workers.contexts import Recent
from workers.steps import Steps


@dataclass(frozen=True, slots=True)
class StageCount:
    """What a question asks in one stage."""

    calls: float = 0
    """Calls."""
    prompt_tokens: float = 0.0
    """Tokens in."""
    completion_tokens: float = 0.0
    """Tokens out."""

    @property
    def tokens(self) -> float:
        """Tokens in and out."""
        return self.prompt_tokens + self.completion_tokens

    def __add__(self, other: StageCount) -> StageCount:
        return StageCount(
            self.calls + other.calls,
            self.prompt_tokens + other.prompt_tokens,
            self.completion_tokens + other.completion_tokens,
        )


@dataclass(frozen=True, slots=True)
class Tried:
    """What one question takes."""

    stages: Mapping[Stage, StageCount]
    """By stage that asks."""
    pictures: int
    """Views rendered for the models to see."""
    cpu_s: float
    """CPU seconds, without those of the models asked over a network and of the scene's visibility index."""


@dataclass(slots=True)
class SceneTrial:
    """What a scene takes once, whatever is asked."""

    maps: int
    """Dominance maps that were not stored before the trial."""
    made: int = 0
    """Those that the trial rendered and stored."""
    cpu_s: float = 0.0
    """CPU seconds of loading it and of all those maps."""


class Trials:
    """Tries questions; of the scenes, the last few are kept open.

    Args:
        config: The job.
        steps: The method.
    """

    def __init__(self, config: JobConfig, steps: Steps) -> None:
        self._config, self._steps = config, steps
        self._models = {name: _CountingModel(name, endpoint) for name, endpoint in config.models.endpoints.items()}
        clients = {stage: self._models[config.models.endpoint_of(stage)] for stage in STAGES}
        self._caller = Caller(clients, Prompts.load(config.models.prompts), None, max_asks=config.models.max_asks)
        self._open: Recent[_Scene] = Recent()
        self.scenes: dict[str, SceneTrial] = {}
        self.unusable: dict[str, str] = {}

    def of(self, unit: PlannedUnit, question: Question) -> Tried:
        """Put a question through the steps that lead to calls; one that fails has asked what it asked until then.

        A scene that cannot be used is noted in `unusable`: its questions ask nothing.
        """
        try:
            return self._of(unit, question)
        except InputError as error:
            self.unusable.setdefault(unit.scene_uri, str(error))
            return Tried({}, 0, 0.0)

    def _of(self, unit: PlannedUnit, question: Question) -> Tried:
        scene = self._open.get(unit.scene_uri, lambda: _Scene(self._config, self._steps, unit.scene_uri))
        of_scene = self.scenes.setdefault(unit.scene_uri, SceneTrial(scene.missing, cpu_s=scene.load_s))
        for model in self._models.values():
            model.begin()
        wall, start = time.perf_counter(), time.process_time()
        pictures, index_wall_s = asyncio.run(self._answer(scene, question))
        taken_s = time.process_time() - start
        index_s = index_wall_s * taken_s / (time.perf_counter() - wall)
        of_scene.made = of_scene.maps - len(scene.unstored.views)
        of_scene.cpu_s += index_s
        stages = {stage: count for model in self._models.values() for stage, count in model.counts.items()}
        unpaid_s = index_s + sum(model.cpu_s for model in self._models.values())
        return Tried(stages, pictures, max(0.0, taken_s - unpaid_s))

    async def _answer(self, scene: _Scene, question: Question) -> tuple[int, float]:
        """Return the pictures rendered and the wall seconds that the scene's index took."""
        steps, method = self._steps, self._config.method
        pictures, index_wall_s = 0, 0.0
        try:
            evidence = await steps.find_evidence(question, scene.vocabulary, self._caller, method)
            proposal = steps.propose(scene.context, question, evidence, method)
            steps.keep_rows(scene.context, method, scene.unstored)
            candidates = (candidate for group in proposal.groups for candidate in group.candidates)
            pictures = len({candidate.picture for candidate in candidates if candidate.source == "render"})
            index_wall_s = sum(taken.seconds for taken in proposal.times if taken.whole_scene)
            await steps.decide(question, proposal, self._caller, method)
        except QuestionError:
            pass
        return pictures, index_wall_s


class _Scene:
    """A scene opened."""

    def __init__(self, config: JobConfig, steps: Steps, uri: str) -> None:
        start = time.process_time()
        scene = steps.load(uri)
        self.context, self.vocabulary = steps.open_context(scene, None), steps.vocabulary(scene)
        found = steps.read_index(scene, config.method, config.visibility_folder())
        steps.adopt_rows(self.context, config.method, found.rows)
        self.unstored = found.unstored
        self.missing = len(found.unstored.views)
        self.load_s = time.process_time() - start


class _CountingModel:
    """The symbolic model in the place of an endpoint, counting what that would be sent."""

    def __init__(self, name: str, endpoint: EndpointConfig) -> None:
        self._name, self._endpoint = name, endpoint
        self._symbolic = SymbolicModel()
        self.begin()

    def begin(self) -> None:
        """Count from zero."""
        self.counts: dict[Stage, StageCount] = {}
        self.cpu_s = 0.0

    @property
    def name(self) -> str:
        return f"{self._name}:{self._endpoint.model}"

    def identity(self) -> Mapping[str, Any]:
        return self._endpoint.identity()

    async def complete(self, request: Request) -> Reply:
        start = time.process_time()
        reply = await self._symbolic.complete(request)
        if self._endpoint.kind != "symbolic":
            self.cpu_s += time.process_time() - start
        prompt = likely_prompt_tokens(request, self._endpoint.image_tokens)
        count = StageCount(1, prompt, max(1.0, likely_text_tokens(reply.text)))
        self.counts[request.stage] = self.counts.get(request.stage, StageCount()) + count
        return reply
