"""The views a finished run showed and chose, and their clusters: enough to cut regions again without a model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.config import MethodConfig
from pipeline.geometry import Camera
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from pipeline.tasks.grounding import Grounder, ShownView, standing_for
from pipeline.tasks.scoring import targets_of
from schemas.questions import Question
from schemas.run_folder import RunFolder


@dataclass(frozen=True, slots=True)
class GroundedArm:
    """An answered arm of a grounding question."""

    context: SceneContext
    """Its scene."""
    question: Question
    """The query, with its targets."""
    arm: str
    """initial, final or verified."""
    iou: float
    """As the run scored it."""
    config: MethodConfig
    """The run's."""
    grounder: Grounder
    """Of the question."""
    views: tuple[ShownView, ...]
    """Views the model was shown."""
    chosen: tuple[ShownView, ...]
    """Those it said show a target."""
    clusters: tuple[np.ndarray, ...]
    """Clusters with views, sorted indices."""
    found: tuple[np.ndarray, ...]
    """All clusters of its categories: also those beyond the cap, and those no view sees."""
    targets: tuple[np.ndarray, ...]
    """Gaussians of each target."""


def grounded_arms(run: str) -> Iterator[GroundedArm]:
    """Yield the answered arms of grounding questions with known targets, scene by scene."""
    folder = RunFolder(run)
    config = MethodConfig.model_validate(folder.read_run()["config"]["method"])
    tables = {name: _table(folder, name) for name in ("answers", "arms", "clusters", "candidates")}
    context, uri = None, ""
    for unit in folder.units():
        wanted = [q for q in unit.questions if q.task != "eqa" and q.target_ids is not None]
        if wanted and unit.scene_uri != uri:
            context, uri = SceneContext(load_scene(unit.scene_uri)), unit.scene_uri
        for question in wanted:
            assert context is not None
            rows = {
                name: table.loc[[question.question_id]] if question.question_id in table.index else table.iloc[:0]
                for name, table in tables.items()
            }
            yield from _arms(context, question, rows, config)


def _table(folder: RunFolder, name: str) -> pd.DataFrame:
    return pa.concat_tables(list(folder.parts(name))).to_pandas().set_index("question_id", drop=False)


def _arms(
    context: SceneContext, question: Question, rows: dict[str, pd.DataFrame], config: MethodConfig
) -> Iterator[GroundedArm]:
    answered = rows["arms"][(rows["arms"]["status"] == "answered") & rows["arms"]["iou"].notna()]
    evidence = [name for answer in rows["answers"].itertuples() for name in answer.evidence]
    truth = targets_of(context, question)
    if not len(answered) or truth is None:
        return
    active = [context.activation(name, config.activation).ids for name in evidence]
    activated = np.unique(np.concatenate([np.empty(0, np.int32), *active])).astype(np.int32)
    seen = rows["clusters"][rows["clusters"]["initial_view"] != ""].sort_values("cluster")
    clusters = tuple(_members(context, row, config) for row in seen.itertuples())
    by_cluster = dict(tuple(rows["candidates"].groupby("cluster", sort=True)))
    candidates = [by_cluster[number]["candidate"].tolist() for number in seen["cluster"]]
    finals = [
        names.index(final) if final in names else None for names, final in zip(candidates, seen["final"], strict=True)
    ]
    cameras = _cameras(context, rows["candidates"])
    grounder = Grounder(context, activated, clusters, config)
    for row in answered.itertuples():
        names = list(row.views)
        own = standing_for(candidates, finals, names)
        views = tuple(ShownView(name, cameras[name], own[name]) for name in names)
        yield GroundedArm(
            context=context,
            question=question,
            arm=row.arm,
            iou=row.iou,
            config=config,
            grounder=grounder,
            views=views,
            chosen=tuple(views[position] for position in row.chosen),
            clusters=clusters,
            found=tuple(ids for name in evidence for ids in context.clusters(name, config)),
            targets=truth,
        )


def _members(context: SceneContext, row: object, config: MethodConfig) -> np.ndarray:
    """The cluster of a row: that of its category with its size and centre."""
    means = context.scene.gaussians.means
    fitting = [ids for ids in context.clusters(row.category, config) if len(ids) == row.gaussians]
    for ids in fitting:
        if np.allclose(means[ids].mean(axis=0, dtype=np.float64), row.centre, atol=1e-9):
            return ids
    raise SystemExit(f"cluster {row.cluster} of {row.question_id} is not there: the run is of another scene or code")


def _cameras(context: SceneContext, candidates: pd.DataFrame) -> dict[str, Camera]:
    """The pose of each candidate, with the lens of the recorded view it starts from."""
    lenses = {view.name: view.camera for view in context.scene.views}
    found = {}
    for row in candidates.itertuples():
        name = row.candidate if row.candidate in lenses else row.candidate.rsplit("/", 2)[0]
        lens, pose = lenses[name], np.asarray(row.world_to_camera, np.float64).reshape(3, 4)
        found[row.candidate] = Camera(lens.K, pose, lens.width, lens.height)
    return found
