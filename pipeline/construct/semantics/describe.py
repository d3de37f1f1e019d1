"""What a scene's Gaussians mean, from its frames: the one call that a build makes, whatever the 2D source is."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float16, Float32, Int32
from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.imports import ImportConfig
from pipeline.construct.semantics.labels_2d.choose import SourceConfig
from pipeline.construct.semantics.labels_2d.clip_model import ClipModel
from pipeline.construct.semantics.labels_2d.label_files import LabelFiles
from pipeline.construct.semantics.labels_2d.sam_clip import SamClip
from pipeline.construct.semantics.labels_2d.scene_frames import with_rendered_depth
from pipeline.construct.semantics.labels_2d.source import FeatureSource, LabelSource
from pipeline.construct.semantics.register import (
    RegistrationConfig,
    RegistrationReport,
    register_features,
    register_labels,
)
from pipeline.render import PreparedGaussians, prepare
from pipeline.scene import Gaussians, Semantics
from pipeline.scene.captures import Frame
from pipeline.scene.objects import SceneObject
from pipeline.scene.semantics import UNLABELLED
from pipeline.scene.text_embeddings import TextEmbeddings
from schemas.errors import InputError

CANONICAL = ("object", "things", "stuff", "texture")
"""Phrases that LERF relevancy compares with; the scene's text file holds them beside the names."""


class SemanticsConfig(BaseModel):
    """Which 2D source describes the scene, and how that reaches the Gaussians."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    source: SourceConfig | None = Field(default=None, description="The 2D source; null builds without categories.")
    registration: RegistrationConfig = Field(
        default_factory=RegistrationConfig, description="How labels and features reach the Gaussians."
    )
    names: Literal["none", "minilm"] = Field(
        default="none",
        description="Embedding of Gaussians with a category: none, or minilm, the vector of the category's name by a "
        "small sentence model. It knows words, not pictures.",
    )
    texts: tuple[str, ...] = Field(
        default=(),
        description="Names and phrases to embed beside the vocabulary and the canonical phrases; open-set sources have "
        "no vocabulary and need them.",
    )


@dataclass(frozen=True, slots=True)
class Described:
    """A scene's semantics and how they came about."""

    semantics: Semantics
    """Category, embedding and instance of every Gaussian, as far as the source says."""
    confidence: Float32[np.ndarray, "M"] | None
    """Share of the winning category in all votes; None for features."""
    texts: TextEmbeddings | None
    """Text side of the embedding; None where there is none."""
    report: RegistrationReport | None
    """What was seen; None for imports."""
    warnings: tuple[str, ...]
    """One line for the scene's record on each thing a reader should know."""
    objects: tuple[SceneObject, ...] = ()
    """Ground-truth objects that the source knows; `semantics.instance` holds their ids."""


def describe(
    gaussians: Gaussians,
    frames: Iterable[Frame],
    config: SemanticsConfig,
    *,
    scene: str = "",
    threads: int = 1,
    progress: Callable[[int], object] | None = None,
) -> Described:
    """Return the semantics of a scene from its frames.

    Depth that a source reads is rendered from the Gaussians through the photograph's lens, so that boxes are cut out
    in captures with another depth lens and in those without depth alike.

    Args:
        gaussians: The scene.
        frames: Frames with photographs, as the source needs them; imports need none.
        config: Source and registration; `config.source` is set.
        scene: Name of the scene, for paths with {scene}.
        threads: Frames registered side by side.
        progress: Called with the number of frames done.

    Raises:
        InputError: No source is set, it cannot be opened, or it cannot read a frame.
    """
    if config.source is None:
        raise InputError("semantics", field="source", expected="a 2D source", found="none")
    if isinstance(config.source, ImportConfig):
        return _imported(gaussians, config.source, config.texts, scene)
    prepared = prepare(gaussians)
    source = config.source.open(scene)
    looked_at = with_rendered_depth(frames, prepared)
    if isinstance(source, SamClip):
        return _open_set(prepared, looked_at, source, config, threads, progress)
    return _closed_set(prepared, looked_at, source, config, threads, progress)


def _closed_set(
    prepared: PreparedGaussians,
    frames: Iterable[Frame],
    source: LabelSource,
    config: SemanticsConfig,
    threads: int,
    progress: Callable[[int], object] | None,
) -> Described:
    found = register_labels(prepared, frames, source, config.registration, threads=threads, progress=progress)
    embedding, texts = None, None
    warnings = [f"categories by {found.report.source}: {found.report.labelled} of {len(prepared)} Gaussians"]
    if config.names == "minilm":
        embedding, texts = embed_names(found.vocabulary, found.category, config.texts)
        warnings.append(f"embeddings are {texts.model} vectors of category names, not of pictures")
    semantics = Semantics(found.vocabulary, found.category, embedding, found.instance)
    objects = source.objects if isinstance(source, LabelFiles) else ()
    present = set() if found.instance is None else set(found.instance.tolist())
    if bare := sum(item.instance not in present for item in objects):
        warnings.append(f"{bare} of {len(objects)} ground-truth objects have no Gaussian: nothing can find them")
    return Described(semantics, found.confidence, texts, found.report, tuple(warnings), objects)


def _open_set(
    prepared: PreparedGaussians,
    frames: Iterable[Frame],
    source: SamClip,
    config: SemanticsConfig,
    threads: int,
    progress: Callable[[int], object] | None,
) -> Described:
    assert isinstance(source, FeatureSource)
    found = register_features(prepared, frames, source, config.registration, threads=threads, progress=progress)
    texts = embed_texts(config.texts, source.clip.model, source.clip.encode)
    warnings = (f"features by {found.report.source}: {found.report.labelled} of {len(prepared)} Gaussians",)
    return Described(Semantics((), None, found.embedding), None, texts, found.report, warnings)


def _imported(gaussians: Gaussians, source: ImportConfig, texts: tuple[str, ...], scene: str) -> Described:
    found = source.read(scene)
    embedding = found.embedding(gaussians)
    clip = ClipModel(source.clip) if source.clip else None
    embedded = None if clip is None else embed_texts(texts, clip.model, clip.encode)
    count = int((embedding != 0).any(axis=1).sum())
    warnings = (f"features of {source.kind}: {count} of {len(gaussians)} Gaussians",)
    return Described(Semantics((), None, embedding), None, embedded, None, warnings)


def embed_names(
    vocabulary: tuple[str, ...], category: Int32[np.ndarray, "M"], texts: Iterable[str] = ()
) -> tuple[Float16[np.ndarray, "M D"], TextEmbeddings]:
    """Return each Gaussian's vector, that of its category's name (zero without one), and the vectors by name.

    Args:
        vocabulary: Category names.
        category: Category of each Gaussian, -1 for none.
        texts: Further names and phrases the scene shall know.

    Raises:
        InputError: A package of the `models` extra is missing.
    """
    from pipeline.construct.semantics.labels_2d.minilm import MiniLm

    encoder = MiniLm()
    embeddings = embed_texts((*vocabulary, *texts), encoder.model, encoder.encode)
    rows = np.zeros((len(vocabulary) + 1, encoder.dimension), np.float16)
    rows[: len(vocabulary)] = embeddings.vectors[: len(vocabulary)]
    assert UNLABELLED == -1, "the last row, of zeros, is that of Gaussians without a category"
    return rows[category], embeddings


def embed_texts(
    texts: Iterable[str], model: str, encode: Callable[[tuple[str, ...]], Float32[np.ndarray, "T D"]]
) -> TextEmbeddings:
    """Return the vectors of texts and of the canonical phrases, each once, in the order given."""
    names = tuple(dict.fromkeys((*texts, *CANONICAL)))
    return TextEmbeddings(names, encode(names), model)
