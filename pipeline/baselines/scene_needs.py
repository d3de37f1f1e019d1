"""What a method that searches features needs of a scene, checked before anything runs; no Gaussian is read."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.baselines.config import AnyMethod, FieldConfig, SceneFieldConfig
from pipeline.config import MethodConfig
from pipeline.query.activate import ActivationConfig
from pipeline.scene.scene_file import SEMANTICS, SceneParts
from pipeline.scene.text_embeddings import FILE, read_text_embeddings
from schemas.errors import InputError
from schemas.questions import TASKS, Task
from schemas.semantics_table import CATEGORY, EMBEDDING, read_semantics_columns


@dataclass(frozen=True, slots=True)
class _Search:
    """What is searched for texts."""

    column: str
    """Column of semantics.parquet."""
    activation: ActivationConfig
    """The rule."""
    texts: str | None
    """File of the texts' embeddings in place of the scene's."""


def check_scene(method: AnyMethod, uri: str, parts: SceneParts) -> None:
    """Refuse a scene with which every question of a method that searches features would fail.

    Args:
        method: The method.
        uri: The scene's folder, as messages name it.
        parts: What lies in it.

    Raises:
        InputError: The scene lacks the features or labels that are searched or the texts' embeddings, or those are of
            another size than the features or lack a canonical phrase.
    """
    search = _search_of(method)
    if search is None:
        return
    columns = {} if parts.semantics is None else read_semantics_columns(parts.semantics)
    if search.column not in columns:
        expected = f"column {search.column}, which method {method.kind} searches"
        found = "no such file" if parts.semantics is None else f"columns {', '.join(columns)}"
        raise InputError(uri, field=SEMANTICS, expected=expected, found=found)
    if search.column == CATEGORY:
        return
    texts = parts.texts if search.texts is None else search.texts.replace("{scene}", parts.name)
    if texts is None:
        expected = f"the embeddings of what method {method.kind} searches for"
        raise InputError(uri, field=FILE, expected=expected, found="no such file")
    embeddings = read_text_embeddings(texts)
    if (size := embeddings.vectors.shape[1]) != columns[EMBEDDING]:
        expected = f"size {columns[EMBEDDING]}, as the features of {uri}"
        raise InputError(texts, field="vectors", expected=expected, found=f"size {size}")
    phrases = search.activation.canonical if search.activation.by == "relevancy" else ()
    if missing := set(phrases) - set(embeddings.names):
        expected = f"the canonical phrases {', '.join(phrases)}, for {uri}"
        raise InputError(texts, field="names", expected=expected, found=f"no {', '.join(sorted(missing))}")


def tasks_of(method: AnyMethod) -> tuple[Task, ...]:
    """Return the tasks of which a method answers questions; those of others it skips."""
    if isinstance(method, MethodConfig):
        return TASKS
    return TASKS[1:] if isinstance(method, FieldConfig) else ("eqa",)


def _search_of(method: AnyMethod) -> _Search | None:
    if isinstance(method, SceneFieldConfig):
        column = EMBEDDING if method.features == "scene" else CATEGORY
        return _Search(column, method.activation(), method.texts)
    activation = getattr(getattr(method, "objects", method), "activation", None)
    if not isinstance(activation, ActivationConfig) or activation.by == "labels":
        return None
    return _Search(EMBEDDING, activation, None)
