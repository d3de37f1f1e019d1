"""What a 2D source says of one frame, and the two protocols that every source keeps: labels, or masks with features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float32, Int32

from pipeline.scene.captures import Frame
from pipeline.scene.semantics import UNLABELLED
from schemas.errors import InputError


@dataclass(frozen=True, slots=True)
class FrameLabels:
    """Labels of one photograph's pixels.

    The images may be of another size than the photograph, with the same field of view: pixels are registered as they
    are here.

    Raises:
        InputError: The images differ in size or an id is under -1.
    """

    category: Int32[np.ndarray, "H W"]
    """Index into the source's vocabulary, -1 where nothing is said."""
    confidence: Float32[np.ndarray, "H W"] | None = None
    """How sure the source is, 0 to 1, as a factor on the pixel's vote; None for 1 everywhere."""
    instance: Int32[np.ndarray, "H W"] | None = None
    """Id of the thing, the same in every frame, -1 where there is none; None where the source has none."""

    def __post_init__(self) -> None:
        for name in ("confidence", "instance"):
            image = getattr(self, name)
            if image is not None and image.shape != self.category.shape:
                raise InputError("labels", field=name, expected=f"shape {self.category.shape}", found=image.shape)
        for name in ("category", "instance"):
            image = getattr(self, name)
            if image is not None and image.size and image.min() < UNLABELLED:
                raise InputError("labels", field=name, expected="ids from -1", found=int(image.min()))
        if self.confidence is not None and not ((self.confidence >= 0) & (self.confidence <= 1)).all():
            raise InputError("labels", field="confidence", expected="0 to 1", found="others")


@dataclass(frozen=True, slots=True)
class FrameFeatures:
    """Masks of one photograph, each with a feature.

    Raises:
        InputError: A mask number has no feature, or a feature is not finite.
    """

    masks: Int32[np.ndarray, "H W"]
    """Row of `features` that each pixel takes, -1 for none; sizes as in `FrameLabels`."""
    features: Float32[np.ndarray, "K D"]
    """One feature a mask, any norm; a row of zeros counts as none."""

    def __post_init__(self) -> None:
        if self.features.ndim != 2 or not np.isfinite(self.features).all():
            raise InputError("features", expected="finite numbers, one row a mask", found=self.features.shape)
        low, high = (int(self.masks.min()), int(self.masks.max())) if self.masks.size else (UNLABELLED, UNLABELLED)
        if low < UNLABELLED or high >= len(self.features):
            raise InputError("masks", expected=f"-1 to {len(self.features) - 1}", found=f"{low} to {high}")


@runtime_checkable
class LabelSource(Protocol):
    """Names what photographs show, from a closed set of categories."""

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """Category names that ids index."""
        ...

    @property
    def description(self) -> str:
        """One line for the scene's record: what the source is, its model and thresholds."""
        ...

    @property
    def silence(self) -> float:
        """How much a pixel left without a label says that nothing of the vocabulary is there, 0 to 1."""
        ...

    def labels(self, frame: Frame) -> FrameLabels:
        """Return the labels of a frame.

        Raises:
            InputError: The frame lacks what the source reads.
        """
        ...


@runtime_checkable
class FeatureSource(Protocol):
    """Describes what photographs show by features of an open set."""

    @property
    def dimension(self) -> int:
        """Size D of a feature."""
        ...

    @property
    def description(self) -> str:
        """One line for the scene's record: what the source is, its models and settings."""
        ...

    def features(self, frame: Frame) -> FrameFeatures:
        """Return the masks of a frame and their features.

        Raises:
            InputError: The frame lacks what the source reads.
        """
        ...
