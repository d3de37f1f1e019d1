"""Language fields searched directly in 3D: Dr. Splat by category and by sentence, and others by what they wrote."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Int32

from pipeline.baselines.config import (
    CategoryFieldConfig,
    FieldConfig,
    SceneFieldConfig,
    ScoresFieldConfig,
    SentenceFieldConfig,
)
from pipeline.baselines.field_file import read_field
from pipeline.baselines.material import Material
from pipeline.baselines.once import once
from pipeline.baselines.steps import BaselineSteps
from pipeline.baselines.symbolic_field import STAND_IN, NamedIn, category_features
from pipeline.models.caller import Caller
from pipeline.query.activate import TextEncoder, activate
from pipeline.query.cluster import cluster_ids
from pipeline.query.evidence import Evidence
from pipeline.query.stopwatch import Stopwatch
from pipeline.scene.semantics import Semantics
from pipeline.scene.text_embeddings import read_text_embeddings
from pipeline.tasks.context import SceneContext
from pipeline.tasks.task_answer import TaskAnswer
from schemas.calls import CallRow
from schemas.errors import InputError
from schemas.questions import Question


def _by_category(
    context: SceneContext, question: Question, evidence: Evidence, config: CategoryFieldConfig, watch: Stopwatch
) -> Material:
    with watch.stage("activate", len(evidence.categories)):
        ids = _searched(context, evidence.categories, config)
    return replace(_grounded(context, question, ids, config, watch), stand_in=_stand_in(config))


def _by_sentence(
    context: SceneContext, question: Question, evidence: Evidence, config: SentenceFieldConfig, watch: Stopwatch
) -> Material:
    with watch.stage("activate", 1):
        ids = _searched(context, [question.question], config)
    return replace(_grounded(context, question, ids, config, watch), stand_in=_stand_in(config))


def _by_file(
    context: SceneContext, question: Question, evidence: Evidence, config: ScoresFieldConfig, watch: Stopwatch
) -> Material:
    uri = config.file.replace("{scene}", context.scene.name).replace("{question_id}", question.question_id)
    with watch.stage("activate", 1):
        if "{question_id}" in config.file:
            field = read_field(uri, context.scene)  # of no use to another question
        else:
            field = once(context, ("field", uri), lambda: read_field(uri, context.scene))
        if field.features is not None:
            semantics = Semantics((), embedding=field.features)
            ids = _fitting(context, semantics, [question.question], config)
        else:
            active = field.valid & (field.scores_of(question, uri) >= config.threshold)
            ids = np.flatnonzero(active).astype(np.int32)
    return _grounded(context, question, ids, config, watch)


def _stand_in(config: SceneFieldConfig) -> str:
    return STAND_IN if config.features == "symbolic" else ""


def _searched(context: SceneContext, texts: Sequence[str], config: SceneFieldConfig) -> Int32[np.ndarray, "_"]:
    """The Gaussians of the scene that fit any of the texts."""
    semantics = context.scene.semantics
    if config.features == "scene":
        return _fitting(context, semantics, texts, config)
    if semantics.category is None:
        raise InputError(context.scene.name, field="category", expected="one per Gaussian", found="none")
    # All Gaussians of a category have its feature, so the rule is put to categories.
    table, encoder = Semantics((), embedding=category_features(semantics.vocabulary)), NamedIn(semantics.vocabulary)
    found = [activate(table, text, config.activation(), encoder).ids for text in texts]
    return np.flatnonzero(np.isin(semantics.category, np.concatenate(found))).astype(np.int32)


def _fitting(
    context: SceneContext, semantics: Semantics, texts: Sequence[str], config: FieldConfig
) -> Int32[np.ndarray, "_"]:
    """The Gaussians that fit any of the texts."""
    encoder: TextEncoder | None = context.scene.texts
    if config.texts is not None:
        uri = config.texts.replace("{scene}", context.scene.name)
        encoder = once(context, ("texts", uri), lambda: read_text_embeddings(uri))
    if encoder is None:
        raise InputError(context.scene.name, field="texts", expected="text_embeddings.npz or `texts`", found="neither")
    found = [activate(semantics, text, config.activation(), encoder).ids for text in texts]
    return np.unique(np.concatenate([np.empty(0, np.int32), *found])).astype(np.int32)


def _grounded(
    context: SceneContext, question: Question, ids: Int32[np.ndarray, "_"], config: FieldConfig, watch: Stopwatch
) -> Material:
    """What is found, as one instance or, for several targets, as one a cluster; nothing found is no instance."""
    regions: tuple[Int32[np.ndarray, "_"], ...] = (ids,) if len(ids) else ()
    if config.instances == "clusters" and question.task == "ground_many":
        with watch.stage("cluster", len(ids)):
            regions = cluster_ids(ids, context.scene.gaussians.means, config.clustering)
    return Material(regions=regions, activated=len(ids), objects=len(regions))


async def _answer(question: Question, material: Material, caller: Caller, calls: list[CallRow]) -> TaskAnswer:
    """Return what was found in words; no model is asked."""
    text = material.reason or f"{material.activated} Gaussians"
    return TaskAnswer("answered", "", text, ())


CATEGORY_FIELD = BaselineSteps("category_field", "grounding", _by_category, _answer, asks_evidence=True)
"""Dr. Splat by category."""
SENTENCE_FIELD = BaselineSteps("sentence_field", "grounding", _by_sentence, _answer)
"""Dr. Splat by sentence."""
SCORES_FIELD = BaselineSteps("scores_field", "grounding", _by_file, _answer)
"""Any other language field, such as ReferSplat."""
