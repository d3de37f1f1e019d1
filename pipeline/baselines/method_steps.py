"""What a method gives to whoever runs it: the four steps of a question, and what it needs of the scene's index."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.models.caller import Caller
from pipeline.query.evidence import Evidence
from pipeline.query.visibility import VisibilityConfig
from pipeline.tasks.context import SceneContext
from pipeline.tasks.decision import Decision
from pipeline.tasks.rows import QuestionRows
from schemas.calls import CallRow
from schemas.questions import Question


@dataclass(frozen=True, slots=True)
class MethodSteps:
    """The steps of one method; the last argument of each but failed_rows is its config."""

    find_evidence: Callable[[Question, Sequence[str], Caller, Any], Awaitable[Evidence]]
    """Question, vocabulary, caller and config to evidence."""
    propose: Callable[[SceneContext, Question, Evidence, Any], Any]
    """Context, question, evidence and config to what the models are shown; CPU only."""
    decide: Callable[[Question, Any, Caller, Any], Awaitable[Decision]]
    """Question, what propose gave, caller and config to decision."""
    conclude: Callable[[SceneContext, Question, Evidence, Any, Decision, Any], QuestionRows]
    """Context, question, evidence, proposal, decision and config to rows; CPU only."""
    failed_rows: Callable[[Question, Exception, tuple[CallRow, ...]], QuestionRows]
    """Question, error and the calls made before it to the rows that record it."""
    visibility: Callable[[Any], VisibilityConfig | None]
    """Config to that of the visibility index it reads; None where it reads none."""
