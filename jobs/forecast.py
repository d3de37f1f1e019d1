"""What a job will ask of its models, before anything is spent: calls, tokens, money and time by stage.

Questions are drawn from every task and scene and answered here, the models' part by the offline symbolic model, until
the stages that make up the bill are known well enough. So clusters, views and prompts are those of the run; replies
are a stand-in: a real model may write longer ones and agree with itself more or less often, which changes how many
calls the exact savings spare. Stored replies are not looked at: what is in the cache already costs less. Rows of the
visibility index that are rendered here are stored for the run.

Time takes every call to last equally long, every CPU slot to be busy, and rendering, waiting and limits to overlap as
they do in a long run: the slowest of them is the run's. Starting Ray and loading a model are not in it.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from jobs.config import JobConfig
from jobs.runs.drive import BATCHES_PER_CPU
from jobs.runs.plan import plan_units
from jobs.runs.progress import Progress, Silent
from jobs.trial import StageCount, Trials, Tried
from pipeline.models.config import STAGES
from pipeline.models.messages import Stage
from schemas.errors import InputError
from schemas.plan import PlannedUnit
from schemas.questions import Question
from workers.method_steps import METHOD_STEPS
from workers.steps import Steps

SECONDS_A_CALL = 2.0
"""Latency taken where nobody knows better: hosted vision models answer short questions in one to three seconds."""
FIRST_SAMPLE = 60
"""Questions tried before anything is known; doubled until the margins are met."""
MOST_SAMPLED = 480
"""Questions tried at most: minutes, also where many scenes must be opened."""
AIM = 0.12
"""Margin that ends the trial: at 95 %, so that 15 % are kept nearly always."""
OF_THE_BILL = 0.05
"""Share from which a stage's margin counts."""
NORMAL_95 = 1.96
"""Standard errors in a 95 % interval."""

Asked = tuple[PlannedUnit, Question]


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
    margin: float
    """Share of its tokens by which the drawing of questions may have missed, at 95 %; 0 where all were tried."""


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
    margin: float
    """As of the stages, of all tokens."""
    pictures: float
    """Views rendered for the models to see."""
    maps: float
    """Dominance maps that were not stored: views of the visibility index still to be rendered, at most."""
    maps_made: int
    """Those of them that the trial rendered and stored."""
    cpu_s: float
    """Seconds of rendering and clustering on all CPU slots."""
    model_s: Mapping[str, float]
    """By endpoint that is asked over a network, the seconds its limits and latency make of all its calls."""
    waiting_s: float
    """Seconds that questions in flight wait for replies, were no endpoint ever busy."""
    notes: tuple[str, ...]
    """What a person should know of the plan, such as poses that cannot be used."""

    @property
    def seconds(self) -> float:
        """How long the run takes: the slowest of what overlaps."""
        return max(self.cpu_s, self.waiting_s, *self.model_s.values())


def forecast(
    config: JobConfig,
    *,
    subject: object = "job",
    sample: int | None = None,
    cpus: int = 1,
    seconds_a_call: float = SECONDS_A_CALL,
    steps: Steps = METHOD_STEPS,
    progress: Progress | None = None,
) -> Forecast:
    """Return what a job will take, by trying some of its questions with no model asked.

    Args:
        config: The job.
        subject: What messages call it, such as its file.
        sample: Questions to try; all are tried where there are fewer. None tries until every stage that is 5 % of the
            bill is known to 12 %, or `MOST_SAMPLED` were tried.
        cpus: CPU slots the run will have.
        seconds_a_call: Latency to reckon with.
        steps: The method.
        progress: Who is told how it goes.

    Raises:
        InputError: The job or a question file is wrong, or no scene can be used.
    """
    shown, notes = progress or Silent(), list[str]()
    units = tuple(plan_units(config.model_copy(update={"cache": "replay"}), subject, notes.append))
    strata = [_spread(found) for found in _by_task(units).values()]
    questions = sum(map(len, strata))
    sharing = Counter((unit.scene_uri, question.task) for unit in units for question in unit.questions)
    trials, tried = Trials(config, steps), [list[Tried]() for _ in strata]
    known = _Known(config, strata, tried)
    most = min(questions, MOST_SAMPLED if sample is None else sample)
    count = min(most, FIRST_SAMPLE) if sample is None else most
    shown.begin(most, 0)
    while True:
        for number, (unit, question) in _next(strata, tried, count):
            one = trials.of(unit, question)
            tried[number].append(_shared(one, sharing[unit.scene_uri, question.task]))
            shown.advance("")
        if count == most or known.well():
            break
        count = min(most, 2 * count)
    if not trials.scenes:
        raise InputError(
            subject, field="scenes", expected="one that can be used", found=next(iter(trials.unusable.values()))
        )
    stages = tuple(known.stage(stage) for stage in STAGES if known.total(stage).calls)
    sampled, scenes = list(trials.scenes.values()), len({unit.scene_uri for unit in units})
    of_scenes = scenes / len(sampled)
    in_flight = config.workers.questions_in_flight or BATCHES_PER_CPU * cpus  # waiting for models, each travels alone
    rounds = known.sum(lambda one: sum(not _is_offline(config, stage) for stage in one.stages))
    return Forecast(
        units=len(units),
        scenes=scenes,
        questions=questions,
        sampled=sum(map(len, tried)),
        stages=stages,
        margin=known.margin(STAGES),
        pictures=known.sum(lambda one: one.pictures),
        maps=sum(scene.maps for scene in sampled) * of_scenes,
        maps_made=sum(scene.made for scene in sampled),
        cpu_s=(known.sum(lambda one: one.cpu_s) + sum(scene.cpu_s for scene in sampled) * of_scenes) / cpus,
        model_s={name: _seconds(config, name, stages, seconds_a_call) for name in config.models.remote_endpoints()},
        waiting_s=rounds * seconds_a_call / in_flight,
        notes=(*notes, *_repeats(units), *(f"{uri} will fail: {why}" for uri, why in trials.unusable.items())),
    )


def _shared(one: Tried, questions: int) -> Tried:
    """Spread what a scene's first question alone pays for, its descriptions, over all that ask for the same ones."""
    count = one.stages.get("caption")
    if count is None:
        return one
    share = StageCount(count.calls / questions, count.prompt_tokens / questions, count.completion_tokens / questions)
    return replace(one, stages={**one.stages, "caption": share})


def _repeats(units: Sequence[PlannedUnit]) -> list[str]:
    """Say how many questions another of their scene asks in the same words."""
    asked = Counter((q.scene, q.task, q.question) for unit in units for q in unit.questions)
    again = sum(asked.values()) - len(asked)
    if not again:
        return []
    (scene, _, text), _ = asked.most_common(1)[0]
    return [f"{again} questions repeat another of their scene; first: {text!r} in {scene}"]


def _is_offline(config: JobConfig, stage: Stage) -> bool:
    return config.models.endpoints[config.models.endpoint_of(stage)].kind == "symbolic"


def _by_task(units: Sequence[PlannedUnit]) -> dict[str, list[Asked]]:
    tasks: dict[str, list[Asked]] = defaultdict(list)
    for unit in units:
        for question in unit.questions:
            tasks[question.task].append((unit, question))
    return tasks


def _spread(found: Sequence[Asked]) -> list[Asked]:
    """Order a task's questions so that the first ones, however many, lie evenly among all: over scenes and kinds."""
    bits = (len(found) - 1).bit_length()
    turned = (int(f"{number:0{bits}b}"[::-1], 2) for number in range(1 << bits))
    return [found[place] for place in turned if place < len(found)]


def _next(
    strata: Sequence[Sequence[Asked]], tried: Sequence[Sequence[Tried]], count: int
) -> Iterator[tuple[int, Asked]]:
    """Yield the questions that bring the trial up to a count, each with its task's number, scene by scene."""
    whole = sum(map(len, strata))
    scenes: dict[str, list[tuple[int, Asked]]] = defaultdict(list)
    for number, stratum in enumerate(strata):
        upto = min(len(stratum), max(2, round(count * len(stratum) / whole)))  # from one, no margin is known
        for asked in stratum[len(tried[number]) : upto]:
            scenes[asked[0].scene_uri].append((number, asked))
    for found in scenes.values():
        yield from found


class _Known:
    """What the questions tried so far say of all: each counts for as many of its task as it was drawn from."""

    def __init__(self, config: JobConfig, strata: Sequence[Sequence[Asked]], tried: Sequence[Sequence[Tried]]) -> None:
        self._config, self._strata, self._tried = config, strata, tried

    def sum(self, of: Callable[[Tried], float]) -> float:
        """Return the sum of a number over all questions."""
        pairs = zip(self._strata, self._tried, strict=True)
        return sum(len(stratum) / len(tried) * sum(map(of, tried)) for stratum, tried in pairs)

    def total(self, stage: Stage) -> StageCount:
        """Return what a stage asks for all questions."""
        return StageCount(
            self.sum(lambda one: one.stages.get(stage, _NOTHING).calls),
            self.sum(lambda one: one.stages.get(stage, _NOTHING).prompt_tokens),
            self.sum(lambda one: one.stages.get(stage, _NOTHING).completion_tokens),
        )

    def stage(self, stage: Stage) -> StageForecast:
        """Return what the plan says of a stage."""
        name, total = self._config.models.endpoint_of(stage), self.total(stage)
        endpoint = self._config.models.endpoints[name]
        usd = 0.0 if endpoint.kind == "symbolic" else None
        if endpoint.price is not None:
            usd = (
                total.prompt_tokens * endpoint.price.prompt + total.completion_tokens * endpoint.price.completion
            ) * 1e-6
        tokens = total.prompt_tokens, total.completion_tokens
        return StageForecast(stage, name, total.calls, *tokens, usd, self.margin((stage,)))

    def margin(self, stages: Sequence[Stage]) -> float:
        """Return how far the tokens of some stages may be off by the drawing, at 95 %, as a share of them.

        Questions count as drawn at random within their task; they lie evenly, which does rather better.
        """
        variance = 0.0
        for stratum, tried in zip(self._strata, self._tried, strict=True):
            tokens = [sum(one.stages.get(stage, _NOTHING).tokens for stage in stages) for one in tried]
            if len(stratum) > len(tokens):
                rest = 1 - len(tokens) / len(stratum)
                variance += len(stratum) ** 2 * rest * statistics.variance(tokens) / len(tokens)
        total = sum(self.total(stage).tokens for stage in stages)
        return NORMAL_95 * math.sqrt(variance) / total if total else 0.0

    def well(self) -> bool:
        """Return whether every stage that matters to the bill is known to within the aim."""
        bill = {stage: self.total(stage).tokens for stage in STAGES}
        return all(self.margin((stage,)) <= AIM for stage in STAGES if bill[stage] > OF_THE_BILL * sum(bill.values()))


_NOTHING = StageCount()


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
