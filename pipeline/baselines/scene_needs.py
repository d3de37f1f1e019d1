"""What a method that searches features needs of a scene, checked before anything runs; no Gaussian is read."""

from __future__ import annotations

from pipeline.baselines.config import AnyMethod, FieldConfig, SceneFieldConfig
from pipeline.config import MethodConfig
from pipeline.query.activate import ActivationConfig
from pipeline.scene.scene_file import SEMANTICS, SceneParts
from pipeline.scene.text_embeddings import FILE, read_text_embeddings
from schemas.errors import InputError
from schemas.questions import TASKS, Task
from schemas.semantics_table import CATEGORY, EMBEDDING, read_semantics_columns

SEARCHED = {"scene": EMBEDDING, "symbolic": CATEGORY}
"""Column that a field searches, by `features`."""


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
    activation, column, texts = _searched(method)
    if activation is None:
        return
    columns = {} if parts.semantics is None else read_semantics_columns(parts.semantics)
    if column not in columns:
        found = "no such file" if parts.semantics is None else f"columns {', '.join(columns)}"
        raise InputError(uri, field=SEMANTICS, expected=f"column {column}, which {_told(method)} searches", found=found)
    if column == CATEGORY:
        return
    if texts is None and parts.texts is None:
        raise InputError(uri, field=FILE, expected=f"the embeddings of {_told(method)}'s texts", found="no such file")
    read = str(texts.replace("{scene}", parts.name) if texts is not None else parts.texts)
    embeddings = read_text_embeddings(read)
    if (size := embeddings.vectors.shape[1]) != columns[EMBEDDING]:
        raise InputError(read, field="vectors", expected=f"size {columns[EMBEDDING]}, as features of {uri}", found=size)
    missing = set(activation.canonical) - set(embeddings.names) if activation.by == "relevancy" else set()
    if missing:
        expected = f"the canonical phrases {', '.join(activation.canonical)}"
        raise InputError(read, field="names", expected=expected, found=f"no {', '.join(sorted(missing))}")


def tasks_of(method: AnyMethod) -> tuple[Task, ...]:
    """Return the tasks of which a method answers questions; those of others it skips."""
    if isinstance(method, MethodConfig):
        return TASKS
    return TASKS[1:] if isinstance(method, FieldConfig) else ("eqa",)


def _searched(method: AnyMethod) -> tuple[ActivationConfig | None, str, str | None]:
    """Return the rule, the column it reads and a file of texts beside the scene's; no rule for other methods."""
    if isinstance(method, SceneFieldConfig):
        return method.activation(), SEARCHED[method.features], method.texts
    if isinstance(method, FieldConfig):
        return None, "", None
    holder = getattr(method, "objects", method)
    activation: ActivationConfig | None = getattr(holder, "activation", None)
    by_labels = activation is None or activation.by == "labels"
    return (None, "", None) if by_labels else (activation, EMBEDDING, None)


def _told(method: AnyMethod) -> str:
    return f"method {method.kind}"
