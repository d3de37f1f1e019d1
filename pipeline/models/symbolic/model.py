"""The `symbolic` model: a deterministic, offline stand-in for a language and a vision model.

It answers every stage by rules. Of an image it reads what a view shows (categories, depth, colours, the lens and which
way is up) and nothing else: no instance, no answer, no position in the world, no camera pose. It is no model of
language or vision and says so by its name in every row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.models.messages import ImagePart, Reply, Request
from pipeline.models.symbolic.answer_view import answer_view
from pipeline.models.symbolic.blind import answer_blind
from pipeline.models.symbolic.caption import caption, caption_object
from pipeline.models.symbolic.choose import choose, verify
from pipeline.models.symbolic.combine import answer_many, answer_one, choose_view
from pipeline.models.symbolic.evidence import rank_evidence
from pipeline.models.symbolic.from_text import answer_from_text
from pipeline.models.symbolic.judge import judge
from pipeline.models.symbolic.parse_question import parse_question
from pipeline.models.symbolic.phrases import Query
from pipeline.models.symbolic.sight import Sight
from pipeline.models.symbolic.view import View
from schemas.errors import InputError

RULES = "2"
"""Version of the rules: it enters every cache key, so it changes whenever an answer may."""
KEPT_VIEWS = 512
"""Perceived views kept, about 100 kB each: the candidates of the questions in flight."""


class SymbolicModel:
    """A chat client that answers by rules.

    Token counts are 0: nothing is read as tokens, and an estimate would look like a measurement.

    Args:
        kept_views: Perceived views kept for the next question about them, at least 1.
    """

    def __init__(self, kept_views: int = KEPT_VIEWS) -> None:
        if kept_views < 1:
            raise InputError("symbolic model", field="kept_views", expected="at least 1", found=kept_views)
        self.sight = Sight(kept_views)

    @property
    def name(self) -> str:
        """Endpoint and model, as rows record it."""
        return "symbolic"

    def identity(self) -> Mapping[str, Any]:
        """Return all that changes an answer besides the request."""
        return {"kind": "symbolic", "rules": RULES}

    async def complete(self, request: Request) -> Reply:
        """Return the reply to a stage's variables and images; the wording of the prompt is not read.

        Raises:
            InputError: The stage is unknown, lacks a variable, or lacks an image.
        """
        return Reply(self._answer(request), model=self.name)

    def _answer(self, request: Request) -> str:
        if request.stage == "caption":
            return self._caption(self.sight.view(self._images(request)[0]), request.variables.get("object"))
        question = str(self._variable(request, "question"))
        match request.stage:
            case "evidence":
                return rank_evidence(question, self._variable(request, "categories"), int(self._variable(request, "k")))
            case "choice" if "design" in request.variables:
                return str(self._choose_by_sight(request, question))
            case "choice":
                return str(choose(question, self._candidates(request)))
            case "verify":
                return str(verify(question, self._candidates(request)))
            case "judge":
                reference, prediction = (str(self._variable(request, key)) for key in ("answer", "prediction"))
                return (
                    f"Your mark: {judge(question, reference, prediction, request.variables.get('extra_answers') or ())}"
                )
            case "answer_text":
                notes, of_objects = self._variable(request, "notes"), request.variables.get("design") == "objects"
                return answer_from_text(question, notes, of_objects=of_objects)
            case "answer_blind":
                return answer_blind(question)
            case "view_answer" | "answer_one" | "answer_many":
                return self._look(request, question)
        raise InputError("symbolic model", field="stage", expected="a known stage", found=request.stage)

    def _caption(self, view: View, name: str | None) -> str:
        """Baselines ask for the same descriptions with every question."""
        key = "" if name is None else name
        if key not in view.captions:
            view.captions[key] = caption(view) if name is None else caption_object(view, name)
        return view.captions[key]

    def _choose_by_sight(self, request: Request, question: str) -> int:
        images = self._images(request)
        texts = self._candidates(request) if request.variables["design"] == "image_text" else ()
        return choose_view(_query(question, images), [self.sight.view(image) for image in images], texts)

    def _look(self, request: Request, question: str) -> str:
        images = self._images(request)
        query = _query(question, images)
        views = [self.sight.view(image) for image in images]
        if request.stage == "view_answer":
            return answer_view(query, views[0]).text
        if request.stage == "answer_one":
            index, text = answer_one(query, views)
            return f"Image {index}\n{text}"
        verdicts = answer_many(query, views)
        return "\n".join(f"Image {index}: {'Yes' if verdict else 'No'}" for index, verdict in enumerate(verdicts))

    def _images(self, request: Request) -> Sequence[ImagePart]:
        images = request.images()
        if not images:
            raise InputError(f"symbolic model, stage {request.stage}", field="images", expected="at least one", found=0)
        return images

    def _variable(self, request: Request, key: str) -> Any:
        if key not in request.variables:
            raise InputError(f"symbolic model, stage {request.stage}", field=key, expected="a value", found="none")
        return request.variables[key]

    def _candidates(self, request: Request) -> Sequence[str]:
        candidates: Sequence[str] = self._variable(request, "candidates")
        if not candidates:
            raise InputError(
                f"symbolic model, stage {request.stage}", field="candidates", expected="at least one", found=0
            )
        return candidates


def _query(question: str, images: Sequence[ImagePart]) -> Query:
    """Read a question with the vocabulary of the images; one without observations has no names to match."""
    names = next((image.observation.vocabulary for image in images if image.observation is not None), ())
    return parse_question(question, names)
