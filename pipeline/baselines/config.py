"""What each baseline is told: one frozen config a kind, and the union of all methods that a job file chooses from."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.config import MethodConfig
from pipeline.metrics.volume import Weighting
from pipeline.query.activate import ActivationConfig
from pipeline.query.candidates import ImageConfig, Source
from pipeline.query.cluster import ClusterConfig
from pipeline.query.evidence import EvidenceConfig
from pipeline.query.visibility import VisibilityConfig

BACKGROUND = ("wall", "floor", "ceiling", "carpet", "door", "rug", "bath mat")
"""Categories that 3D-Mem takes for no object."""


class Baseline(BaseModel):
    """What every baseline has."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    mark: bool = Field(default=True, description="Ask the judge for LLM-Match marks where a reference is known.")


class Shown(Baseline):
    """A baseline that shows recorded views."""

    long_side: int = Field(
        default=512, ge=16, description="Longest image side, pixels; views recorded smaller keep their size."
    )
    image: Source = Field(
        default="photo", description="photo: a view's photograph, its render where there is none. render: its render."
    )

    def images(self) -> ImageConfig:
        """Return how pictures are made."""
        return ImageConfig(long_side=self.long_side, initial_image=self.image)


class Objects(BaseModel):
    """How the objects of a scene are found: clusters of each category, as in the paper's method."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    activation: ActivationConfig = Field(default_factory=ActivationConfig, description="Gaussian search.")
    clustering: ClusterConfig = Field(default_factory=ClusterConfig, description="Clusters.")
    visibility: VisibilityConfig = Field(default_factory=VisibilityConfig, description="Which views see an object.")
    background: tuple[str, ...] = Field(default=BACKGROUND, description="Categories that are no objects.")

    def method(self) -> MethodConfig:
        """Return the stages as the paper's method has them."""
        return MethodConfig(activation=self.activation, clustering=self.clustering, visibility=self.visibility)


class BlindConfig(Baseline):
    """A language model that is told the question and nothing of the scene."""

    kind: Literal["blind"] = Field(default="blind", description="The method.")


class FrameCaptionsConfig(Shown):
    """Descriptions of evenly spaced views, from which a language model answers."""

    kind: Literal["frame_captions"] = Field(default="frame_captions", description="The method.")
    frames: int = Field(default=50, ge=1, le=1000, description="Views described, evenly spaced (paper: 50).")


class SceneGraphConfig(Shown):
    """Objects with descriptions and spatial relations, in text, from which a language model answers."""

    kind: Literal["scene_graph_captions"] = Field(default="scene_graph_captions", description="The method.")
    objects: Objects = Field(default_factory=Objects, description="How objects are found.")
    max_objects: int = Field(default=200, ge=1, description="Most objects listed, those of which views see most.")
    margin: float = Field(
        default=0.25, ge=0, description="What a cut-out shows around an object, as a share of the object's size."
    )


class VoxelCaptionsConfig(Baseline):
    """Objects read off a sparse map of labelled voxels, in text, from which a language model answers."""

    kind: Literal["voxel_captions"] = Field(default="voxel_captions", description="The method.")
    voxel_m: float = Field(default=0.15, gt=0, description="Side of a voxel, metres.")
    min_voxels: int = Field(default=3, ge=1, description="Objects of fewer voxels are left out.")
    max_objects: int = Field(default=200, ge=1, description="Most objects listed, the largest.")
    background: tuple[str, ...] = Field(default=BACKGROUND, description="Categories that are no objects.")


class MultiFrameConfig(Shown):
    """Evenly spaced views, shown with the question."""

    kind: Literal["multi_frame"] = Field(default="multi_frame", description="The method.")
    frames: int = Field(default=3, ge=1, le=1000, description="Views shown, evenly spaced (paper: 3).")


class MemorySnapshotsConfig(Shown):
    """3D-Mem's memory snapshots: few recorded views that together hold all objects, those of the evidence shown."""

    kind: Literal["memory_snapshots"] = Field(default="memory_snapshots", description="The method.")
    evidence: EvidenceConfig = Field(default_factory=EvidenceConfig, description="Categories kept (its prefiltering).")
    objects: Objects = Field(default_factory=Objects, description="How objects are found.")
    min_visibility: float = Field(
        default=0.05, ge=0, le=1, description="Share of an object that a view must see to hold it."
    )
    max_distance_m: float = Field(
        default=3.5, gt=0, description="Objects farther from a view than this are not in it, metres (3D-Mem: 3.5)."
    )
    file: str | None = Field(
        default=None,
        description="snapshots made elsewhere, a JSON file a scene; {scene} in the path stands for its name. Null "
        "makes them here",
    )


class FieldConfig(Baseline):
    """How a language field says which Gaussians are meant."""

    by: Literal["relevancy", "cosine"] = Field(
        default="relevancy",
        description="relevancy: LERF relevancy over the canonical phrases, above `threshold` (Dr. Splat's code). "
        "cosine: cosine of feature and text, at least `threshold` (as the paper writes).",
    )
    threshold: float = Field(default=0.5, ge=-1, le=1, description="See `by`.")
    canonical: tuple[str, ...] = Field(
        default=("object", "things", "stuff", "texture"), min_length=1, description="Phrases to beat (relevancy)."
    )
    temperature: float = Field(default=10.0, gt=0, description="Factor in the softmax (relevancy).")
    texts: str | None = Field(
        default=None,
        description="NPZ file with `names` and `vectors` of the texts that are searched for; {scene} in the path "
        "stands for the scene's name. Null takes the scene's text_embeddings.npz",
    )
    instances: Literal["one", "clusters"] = Field(
        default="one",
        description="one: what is found is one instance, as these methods tell none apart. clusters: each of its "
        "clusters is one, for questions with several targets.",
    )
    clustering: ClusterConfig = Field(default_factory=ClusterConfig, description="With instances: clusters.")
    weighting: Weighting = Field(default="percentile", description="Weights of the IoU.")

    def activation(self) -> ActivationConfig:
        """Return the rule as the paper's method has it."""
        return ActivationConfig(
            by=self.by, threshold=self.threshold, canonical=self.canonical, temperature=self.temperature
        )


class SceneFieldConfig(FieldConfig):
    """A field whose features lie in the scene."""

    features: Literal["scene", "symbolic"] = Field(
        default="scene",
        description="scene: the embedding of each Gaussian in semantics.parquet. symbolic: an offline stand-in for "
        "scenes with labels alone, named so in the rows: one direction a category, a sentence lies between those it "
        "names",
    )


class CategoryFieldConfig(SceneFieldConfig):
    """Dr. Splat by category: Gaussians whose feature fits the evidence category."""

    kind: Literal["category_field"] = Field(default="category_field", description="The method.")
    evidence: EvidenceConfig = Field(default_factory=EvidenceConfig, description="Categories searched for.")


class SentenceFieldConfig(SceneFieldConfig):
    """Dr. Splat by sentence: Gaussians whose feature fits the whole query."""

    kind: Literal["sentence_field"] = Field(default="sentence_field", description="The method.")


class ScoresFieldConfig(FieldConfig):
    """Any other language field, such as ReferSplat, by the features or scores that it wrote to a file."""

    kind: Literal["scores_field"] = Field(default="scores_field", description="The method.")
    file: str = Field(
        min_length=1,
        description="NPZ file with `scores` or `features`, and `valid`, a row per Gaussian in the order of the PLY "
        "file; or a Dr. Splat checkpoint (.pth). {scene} and {question_id} in the path stand for theirs",
    )


AnyMethod = Annotated[
    MethodConfig
    | BlindConfig
    | FrameCaptionsConfig
    | SceneGraphConfig
    | VoxelCaptionsConfig
    | MultiFrameConfig
    | MemorySnapshotsConfig
    | CategoryFieldConfig
    | SentenceFieldConfig
    | ScoresFieldConfig,
    Field(discriminator="kind"),
]
"""A method of a job file, told apart by `kind`."""


def files_of(method: AnyMethod, scene: str, question_id: str) -> tuple[str, ...]:
    """Return the files beside the scene that a method reads for a question."""
    named = (getattr(method, field, None) for field in ("file", "texts"))
    return tuple(name.replace("{scene}", scene).replace("{question_id}", question_id) for name in named if name)
