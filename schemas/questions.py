"""One question about one scene, and what is known of its answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from schemas.errors import InputError

Task = Literal["eqa", "ground_one", "ground_many"]
"""eqa: a text answer; ground_one: the Gaussians of one object; ground_many: of zero, one or several."""

TASKS: tuple[Task, ...] = get_args(Task)


@dataclass(frozen=True, slots=True)
class Question:
    """One line of a question file.

    Raises:
        InputError: A text is empty, the task is unknown, or a grounding question lacks its fields.
    """

    question_id: str
    """Unique in a run."""
    scene: str
    """Name of the scene it is about."""
    task: Task
    """What is asked for."""
    question: str
    """The natural-language query Q."""
    answer: str | None = None
    """Reference answer (eqa); None when there is none to score against."""
    extra_answers: tuple[str, ...] = ()
    """Other answers the reference accepts (OpenEQA object localization)."""
    category: str = ""
    """Question type used to group scores, such as "spatial understanding" or "multi-target"."""
    target_ids: tuple[int, ...] | None = None
    """Ground-truth instance ids (grounding); () asks for nothing to be found, None is unknown."""
    target_category: str = ""
    """Category name of the target (grounding), for grouping; the method never reads it."""

    def __post_init__(self) -> None:
        for name in ("question_id", "scene", "question"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value.strip():
                raise InputError(
                    f"question {self.question_id!r}", field=name, expected="a text that is not empty", found=repr(value)
                )
        if self.task not in TASKS:
            raise InputError(
                f"question {self.question_id!r}", field="task", expected=f"one of {', '.join(TASKS)}", found=self.task
            )
