"""The seam between dispatch and the method: the functions a question's DAG runs, as one value.

Runners call these and nothing else, so tests and the scale simulation put other functions in their place, and the
method never learns where it runs.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from schemas.questions import Question
from workers.index_steps import FoundIndex

Tables = Mapping[str, tuple[Any, ...]]
"""Records by table name, all of one question."""


@dataclass(frozen=True, slots=True)
class Work:
    """What every worker of a run needs; pickled once, small, and free of secrets."""

    method: Any
    """Config of the paper's method or of a baseline."""
    models: Any
    """ModelConfig."""
    calls: str
    """Folder of the call cache."""
    visibility: str
    """Folder of the visibility index."""
    images: str
    """Run folder in which thumbnails go below images/; empty for none."""
    cache: Literal["on", "off", "replay"] = "on"
    """Whether stored replies are used and kept, neither, or all there is."""
    budget: Any = None
    """BudgetConfig; None for no caps."""
    journals: str = ""
    """Folder for the journals of what the run's calls cost."""
    session: str = ""
    """Name of this session of the run, unlike that of any other."""


@dataclass(frozen=True, slots=True)
class Steps:
    """The functions of a question's DAG; all are module-level, so they pickle by name.

    load and prepare run once a scene, open_context once a scene and process, the steps after adopt_index once a
    question.

    The visibility index is read from disk first. A runner with one process then adopts the rows; one with many
    spreads the missing views over them, joins all rows once and hands that on. Both keep what a context renders beside.
    """

    load: Callable[[str], Any]
    """Scene URI to scene."""
    vocabulary: Callable[[Any], Any]
    """Scene to the small value that evidence needs of it."""
    prepare: Callable[[Any], Any]
    """Scene to what every context needs beside it, computed once and shared by the processes of a node."""
    open_context: Callable[[Any, Any], Any]
    """Scene and that, or None to compute it when needed, to the per-process context with its caches."""
    make_caller: Callable[[Work, Mapping[str, Any]], Any]
    """Work and, by endpoint, the gates its calls pass, to the caller that asks the models."""
    close_caller: Callable[[Any], Awaitable[None]]
    """Caller: it asks no more."""
    read_index: Callable[[Any, Any, str], FoundIndex]
    """Scene, method config, folder of the index to what lies there of it."""
    adopt_rows: Callable[[Any, Any, Mapping[int, Any]], None]
    """Context, method config and rows by view: they need not be rendered here."""
    keep_rows: Callable[[Any, Any, Any], int]
    """Context, method config and what the disk lacks: stores what was rendered here of it, and says how many rows."""
    index_views: Callable[[Any, Any, Any, int, int], Any]
    """Context, method config, what the disk lacks, part and number of parts: renders and stores that part."""
    join_index: Callable[[Any, Any, Sequence[Any]], Any]
    """Scene, method config and all parts, those from disk among them, to one value."""
    adopt_index: Callable[[Any, Any, Any], None]
    """Context, method config and that value: nothing of it need be rendered here."""
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
    failed_rows: Callable[[Question, Exception, Any], Any]
    """Question, error and method config to the rows that record it."""
