"""The seam between dispatch and the method: the functions a question's DAG runs, as one value.

Runners call these and nothing else, so tests and the scale simulation put other functions in their place, and the
method never learns where it runs.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

from schemas.questions import Question

Tables = Mapping[str, tuple[Any, ...]]
"""Records by table name, all of one question."""


@dataclass(frozen=True, slots=True)
class Work:
    """What every worker of a run needs; pickled once, small, and free of secrets."""

    method: Any
    """MethodConfig."""
    models: Any
    """ModelConfig."""
    calls: str
    """Folder of the call cache."""
    images: str
    """Run folder in which thumbnails go below images/; empty for none."""


@dataclass(frozen=True, slots=True)
class Steps:
    """The functions of a question's DAG; all are module-level, so they pickle by name.

    load runs once a scene, open_context once a scene and process, the steps after index_views once a question.
    index_views spreads over workers what every process would else compute for itself; a runner with one process
    leaves it out, since contexts compute what they lack.
    """

    load: Callable[[str], Any]
    """Scene URI to scene."""
    vocabulary: Callable[[Any], Any]
    """Scene to the small value that evidence needs of it."""
    open_context: Callable[[Any], Any]
    """Scene to the per-process context with its caches."""
    make_caller: Callable[[Work], Any]
    """Work to the caller that asks the models."""
    index_views: Callable[[Any, Any, int, int], tuple[Any, int]]
    """Context, method config, part and number of parts to that part of the visibility index, and its views."""
    adopt_index: Callable[[Any, Any, Any], None]
    """Context, method config and a part from another process: that part need not be computed here."""
    find_evidence: Callable[[Question, Any, Any, Any], Awaitable[Any]]
    """Question, vocabulary, caller, method config to evidence."""
    propose: Callable[[Any, Question, Any, Any], Any]
    """Context, question, evidence, method config to candidate views; CPU only."""
    decide: Callable[[Question, Any, Any, Any], Awaitable[Any]]
    """Question, proposal, caller, method config to decision."""
    conclude: Callable[[Any, Question, Any, Any, Any, Any], Any]
    """Context, question, evidence, proposal, decision, method config to rows; CPU only."""
    thumbnails: Callable[[Any, Any], Mapping[str, Any]]
    """Proposal and rows to RGB images by their path below the run folder."""
    tables: Callable[[Any], Tables]
    """Rows to records by table."""
    failed_rows: Callable[[Question, Exception], Any]
    """Question and error to the rows that record it."""
