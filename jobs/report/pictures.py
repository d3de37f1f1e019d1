"""Which questions of a run get pictures drawn from their scene's files, and the drawing, within a budget."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from jobs.progress import Progress, Silent
from jobs.report.questions import Questions, standing_arm
from jobs.report.scene_places import find_scene, planned_scenes
from jobs.report.shards import DataFolder
from jobs.report.top_down import frame_of, up_of
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
    chosen = spread(listed, budget.questions)
    by_scene: dict[str, list[str]] = {}
    for place in sorted(chosen):
        by_scene.setdefault(listed[place]["scene"], []).append(listed[place]["id"])
    if not chosen:
        return found
    # Imported here: kernels and the scene loaders take a second that a page without pictures need not wait for.
    from jobs.report.drawing import ToDraw, draw_scene

    planned, targets = planned_scenes(run), _targets(run)
    deadline = time.monotonic() + budget.seconds
    threads = budget.threads or len(os.sched_getaffinity(0))

    def goes_on() -> bool:
        shown.advance("")
        return time.monotonic() < deadline

    shown.begin(len(chosen), 0)
    for name, ids in by_scene.items():
        place = find_scene(run, planned[name], budget.scenes)
        if place.problem or time.monotonic() > deadline:
            if place.problem:
                found.problems[name] = place.problem
                shown.say(place.problem)
            for _ in ids:
                shown.advance("")
            continue
        wanted = []
        for question in ids:
            regions = questions.rows("regions", question)
            last = standing_arm({str(row["arm"]) for row in regions})
            own = [row for row in regions if row["arm"] == last]
            clusters, candidates = (questions.rows(table, question) for table in ("clusters", "candidates"))
            wanted.append(ToDraw(question, clusters, candidates, own, targets.get(question, ())))
        try:
            drawn = draw_scene(place.uri, method, wanted, folder, threads=threads, goes_on=goes_on)
        except SplatReasonerError as error:
            found.problems[name] = str(error)
            shown.say(f"scene {name}: {error}")
            continue
        found.maps[name] = drawn.map
        found.questions.update(drawn.questions)
    shown.end()
    total, drawn_count = len(listed), len(found.questions)
    if drawn_count < total:
        found.note = f"Overlays are drawn for {drawn_count:,} of {total:,} questions; report --overlays N draws more."
    return found


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
            place = next((place for place in group if place not in chosen), None)
            if place is None:
                waiting.remove(group)
            elif len(chosen) < count:
                chosen[place] = None
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
    from jobs.coverage import read_plan

    plan: pd.DataFrame = read_plan(run)
    known = plan[plan["target_ids"].notna()]
    return {row["question_id"]: tuple(map(int, row["target_ids"])) for row in known.to_dict("records")}
