"""What a run says of one scene: its questions, and the clusters, views and groundings of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from jobs.dataset import scene_sha256
from jobs.drawing.question import method_of
from jobs.drawing.scene_places import planned_scenes
from jobs.drawing.to_draw import ToDraw
from jobs.scoring.arm_order import standing_arm
from jobs.scoring.coverage import read_plan
from pipeline.config import MethodConfig
from schemas.errors import InputError
from schemas.run_folder import RunFolder
from schemas.run_rows import RunRows

OF_A_QUESTION = ("clusters", "candidates", "regions")
NAMED = 8
"""Names that an error tells."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A question and what a run answered."""

    question_id: str
    """Question."""
    text: str
    """As it was asked."""
    task: str
    """Its task."""
    status: str
    """How it ended."""
    answer: str
    """Answer; empty where there is none."""
    reference: str
    """Ground truth of a text answer; empty where there is none."""


class RunScene:
    """The committed questions of one scene in a run.

    Args:
        run: Run folder, a path or URI.
        scene_uri: The scene; its files must be those of one that the run planned.

    Raises:
        InputError: There is no such run, it has no such scene, or the scene's files have changed since it was planned.
    """

    def __init__(self, run: str, scene_uri: str) -> None:
        config = RunFolder(run).read_run().get("config")
        self.method: MethodConfig | None = method_of(config.get("method", {}) if isinstance(config, dict) else {})
        """The run's method; None for one that has no clusters."""
        self.name = _planned_name(run, scene_uri)
        """The scene's name in the run."""
        self._rows = RunRows(run)
        plan = read_plan(run)
        plan = plan[plan["scene"] == self.name]
        known = plan[plan["target_ids"].notna()]
        self._targets = {row["question_id"]: tuple(map(int, row["target_ids"])) for row in known.to_dict("records")}
        answers = self._rows.of(plan["question_id"], "answers").to_dict("records")
        self.questions = {str(row["question_id"]): _asked(row) for row in answers}
        """Committed questions by id, in plan order."""

    def to_draw(self, question_id: str) -> ToDraw:
        """Return what is drawn of a question.

        Raises:
            InputError: The scene has no committed question of that id.
        """
        if question_id not in self.questions:
            few = ", ".join(list(self.questions)[:NAMED]) or "none is committed"
            raise InputError("--question", expected=f"a committed question of {self.name}: {few}", found=question_id)
        clusters, candidates, regions = (self._of(question_id, name) for name in OF_A_QUESTION)
        last = standing_arm({str(row["arm"]) for row in regions})
        counted = [row for row in regions if row["arm"] == last]
        return ToDraw(question_id, clusters, candidates, counted, self._targets.get(question_id, ()))

    def _of(self, question_id: str, name: str) -> list[dict[str, Any]]:
        rows = self._rows.of([question_id], name).to_dict("records")
        return [{str(key): value for key, value in row.items()} for row in rows]


def _planned_name(run: str, scene_uri: str) -> str:
    planned, sha256 = planned_scenes(run), scene_sha256(scene_uri)
    for scene in planned.values():
        if scene.sha256 == sha256:
            return scene.name
    few = ", ".join(list(planned)[:NAMED])
    expected = f"a run over {scene_uri} with the files it has now"
    raise InputError(run, expected=expected, found=f"scenes of other content: {few}")


def _asked(row: dict[Any, Any]) -> Asked:
    reference = row["reference"] if isinstance(row["reference"], str) else ""
    status = str(row["status"])
    told = str(row["answer"] if status == "answered" else row["reason"])
    return Asked(str(row["question_id"]), str(row["question"]), str(row["task"]), status, told, reference)
