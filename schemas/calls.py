"""Tables `calls` (one row a model call) and `timings` (one row a question and stage)."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.table import Added, TableSpec


@dataclass(frozen=True, slots=True)
class CallRow:
    """Table `calls`: one model call, sent or answered from the cache."""

    question_id: str
    """Question."""
    scene: str
    """Scene."""
    stage: str
    """evidence, view_answer, choice, verify, answer, judge; caption in baselines."""
    subject: str
    """What it was about: a candidate id, a cluster, an arm; empty for the question itself."""
    key: str
    """SHA-256 of all that counts: endpoint, model, parameters, messages, image bytes."""
    endpoint: str
    """Endpoint's name in the job file."""
    model: str
    """Model."""
    prompt_sha256: str
    """Hash of the prompt template."""
    attempt: int
    """1 for the first ask, 2 and up after an unreadable reply."""
    outcome: str
    """ok, unparsed, or the error's class name."""
    reply: str
    """The reply as it came."""
    prompt_tokens: int
    """Tokens in, as the server counts them; 0 for symbolic."""
    completion_tokens: int
    """Tokens out."""
    wait_s: float
    """Seconds it waited for the endpoint's limits before it was sent; 0 when cached."""
    latency_s: float
    """Seconds from sending to the reply; 0 when cached."""
    usd: float | None
    """Price by the endpoint's price list, US dollars; 0 when cached, null where there is no price."""
    cached: bool
    """Answered from the cache: nothing was sent."""
    prompt: str = ""
    """Text of the request, a line `=== role ===` before each message and `[image HASH]` where a picture stood; empty
    where the job keeps none, and in parts of versions 1 and 2."""


@dataclass(frozen=True, slots=True)
class TimingRow:
    """Table `timings`: seconds a stage took for a question. Differs between runs, so it stands apart."""

    question_id: str
    """Question; empty for work done once a scene."""
    scene: str
    """Scene."""
    stage: str
    """load, prepare, index_read, index, index_join, evidence, activate, cluster, visibility, perturb, render, ..."""
    seconds: float
    """Wall seconds."""
    count: int
    """Items handled: views rendered, calls made."""


@dataclass(frozen=True, slots=True)
class RegionRow:
    """Table `regions`: the Gaussians grounded for a question and arm, one row a predicted instance."""

    question_id: str
    """Question."""
    scene: str
    """Scene."""
    arm: str
    """initial, final or verified."""
    instance: int
    """Predicted instance, 0-based."""
    view: str
    """Candidate id of the view that grounds it."""
    gaussians: tuple[int, ...]
    """Sorted indices into the scene's Gaussians."""
    rule: str = ""
    """Region rule that cut it, such as frustum; frustum in parts of version 1."""


CALLS = TableSpec(
    name="calls",
    version=3,
    work=2,
    record=CallRow,
    key=("question_id", "stage", "subject", "attempt"),
    columns={
        "question_id": "string",
        "scene": "string",
        "stage": "string",
        "subject": "string",
        "key": "string",
        "endpoint": "string",
        "model": "string",
        "prompt_sha256": "string",
        "attempt": "int32",
        "outcome": "string",
        "reply": "string",
        "prompt_tokens": "int64",
        "completion_tokens": "int64",
        "wait_s": "float64",
        "latency_s": "float64",
        "usd": "float64?",
        "cached": "bool",
        "prompt": "string",
    },
    added={"wait_s": Added(2, 0.0), "usd": Added(2), "prompt": Added(3, "")},
)

CALL_FIGURES = tuple(name for name in CALLS.columns if name != "prompt")
"""Columns that costs are made of: all but the texts of requests, most of what a call takes in memory."""

TIMINGS = TableSpec(
    name="timings",
    version=1,
    record=TimingRow,
    key=("question_id", "stage"),
    columns={"question_id": "string", "scene": "string", "stage": "string", "seconds": "float64", "count": "int64"},
)

REGIONS = TableSpec(
    name="regions",
    version=2,
    record=RegionRow,
    key=("question_id", "arm", "instance"),
    columns={
        "question_id": "string",
        "scene": "string",
        "arm": "string",
        "instance": "int32",
        "view": "string",
        "gaussians": "list<int32>",
        "rule": "string",
    },
    added={"rule": Added(2, "frustum")},
)
