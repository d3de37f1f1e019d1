"""Which questions of a run get pictures drawn from their scene's files, and the drawing, within a budget."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jobs.drawing.map_frame import frame_of, up_of
from jobs.drawing.scene_places import find_scene, planned_scenes
from jobs.drawing.to_draw import ToDraw
from jobs.report.questions import Questions
from jobs.report.shards import DataFolder
from jobs.runs.progress import Progress, Silent
from jobs.scoring.arm_order import standing_arm
from jobs.scoring.coverage import read_plan
from schemas.errors import SplatReasonerError


@dataclass(frozen=True, slots=True)
class DrawingBudget:
    """How much is drawn."""

    questions: int = 24
    """Questions at most; 0 draws nothing."""
    seconds: float = 120.0
    """No question is begun after so long."""
    scenes: str = ""
    """Folder with the scenes' folders; empty for where the plan says they are."""
    threads: int | None = None
    """Questions drawn side by side; None for as many as there are cores."""


@dataclass(slots=True)
class Pictures:
    """What was drawn."""

    maps: dict[str, dict[str, Any]] = field(default_factory=dict)
    """By scene: the frame of its map, and its picture where there is one."""
    questions: dict[str, dict[str, Any]] = field(default_factory=dict)
    """By question, see `DrawnScene`."""
    problems: dict[str, str] = field(default_factory=dict)
    """By scene: why nothing was drawn from it."""
    note: str = ""
    """What was left out, and how to get it."""


def draw_pictures(
    run: str,
    method: Mapping[str, Any],
    questions: Questions,
    listed: Sequence[Mapping[str, Any]],
    folder: DataFolder,
    budget: DrawingBudget,
    progress: Progress | None = None,
) -> Pictures:
    """Return the pictures of some questions of a run, after writing them; a scene that is not at hand stops nothing.

    Args:
        run: Run folder.
        method: The job's method.
        questions: All of them.
        listed: The same as the list shows them.
        folder: Where pictures go.
        budget: How many, how long.
        progress: Who is told how it goes; None for nobody.
    """
    shown, found = progress or Silent(), Pictures(_bare_maps(questions))
    by_scene: dict[str, list[str]] = {}
    for place in sorted(spread(listed, budget.questions)):
        by_scene.setdefault(str(listed[place]["scene"]), []).append(str(listed[place]["id"]))
    if by_scene:
        shown.begin(sum(map(len, by_scene.values())), 0)
        try:
            _draw(run, method, questions, by_scene, folder, budget, shown, found)
        finally:
            shown.end()
    if len(found.questions) < len(listed):
        counts = f"{len(found.questions):,} of {len(listed):,} questions"
        found.note = f"Overlays are drawn for {counts}; report --overlays N draws more."
    return found


def _draw(
    run: str,
    method: Mapping[str, Any],
    questions: Questions,
    by_scene: Mapping[str, Sequence[str]],
    folder: DataFolder,
    budget: DrawingBudget,
    shown: Progress,
    found: Pictures,
) -> None:
    # Imported here: kernels and the scene loaders take a second that a page without pictures need not wait for.
    from jobs.report.drawing import draw_scene

    planned, targets = planned_scenes(run), _targets(run)
    deadline = time.monotonic() + budget.seconds
    threads = budget.threads or len(os.sched_getaffinity(0))

    def goes_on() -> bool:
        shown.advance("")
        return time.monotonic() < deadline

    for name, ids in by_scene.items():
        if time.monotonic() >= deadline:
            return
        scene = find_scene(run, planned[name], budget.scenes)
        problem = scene.problem
        if not problem:
            wanted = [_to_draw(questions, question, targets) for question in ids]
            try:
                drawn = draw_scene(scene.uri, method, wanted, folder, threads=threads, goes_on=goes_on)
            except SplatReasonerError as error:
                problem = f"Nothing can be drawn of scene {name}: {error}"
            else:
                found.maps[name] = drawn.map
                found.questions.update(drawn.questions)
        if problem:
            found.problems[name] = problem
            shown.say(problem)
            for _ in ids:
                shown.advance("not at hand")


def _to_draw(questions: Questions, question: str, targets: Mapping[str, tuple[int, ...]]) -> ToDraw:
    regions = questions.rows("regions", question)
    last = standing_arm({str(row["arm"]) for row in regions})
    return ToDraw(
        question,
        questions.rows("clusters", question),
        questions.rows("candidates", question),
        [row for row in regions if row["arm"] == last],
        targets.get(question, ()),
    )


def spread(listed: Sequence[Mapping[str, Any]], count: int) -> list[int]:
    """Return places of questions, about as many of each task and label: what people open by filter is then drawn."""
    groups: dict[tuple[str, str], list[int]] = {}
    for place, row in enumerate(listed):
        for label in row["labels"]:
            groups.setdefault((str(row["task"]), label), []).append(place)
    chosen: dict[int, None] = {}
    waiting = [iter(group) for group in groups.values()]
    while waiting and len(chosen) < count:
        for group in tuple(waiting):
            new = next((place for place in group if place not in chosen), None)
            if new is None:
                waiting.remove(group)
            elif len(chosen) < count:
                chosen[new] = None
    return list(chosen)


def _bare_maps(questions: Questions) -> dict[str, dict[str, Any]]:
    """Frames from poses and centres alone, for scenes that are not drawn."""
    found = {}
    for name, rows in questions.table("candidates").groupby("scene", sort=False):
        poses = np.stack([np.asarray(pose, np.float64) for pose in rows["world_to_camera"]]).reshape(-1, 3, 4)
        stands = -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3])
        clusters = questions.table("clusters")
        centres = [np.asarray(centre, np.float64) for centre in clusters.loc[clusters["scene"] == name, "centre"]]
        points = np.stack([*stands, *centres])
        found[str(name)] = frame_of(up_of(rows["world_to_camera"].tolist()), points, points).as_data()
    return found


def _targets(run: str) -> dict[str, tuple[int, ...]]:
    plan = read_plan(run)
    known = plan[plan["target_ids"].notna()]
    return {row["question_id"]: tuple(map(int, row["target_ids"])) for row in known.to_dict("records")}
