"""What all detectors share: thresholds, the names they may give, and the way from boxes to labels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, UInt8
from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.labels_2d.boxes import Detection, labels_of
from pipeline.construct.semantics.labels_2d.source import FrameLabels
from pipeline.scene.captures import Frame


class DetectorConfig(BaseModel):
    """Thresholds of any detector."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    least_confidence: float = Field(default=0.4, gt=0, le=1, description="Detections under this are dropped.")
    ignore: tuple[str, ...] = Field(default=("person",), description="Names left out.")
    depth: bool = Field(default=True, description="Keep of each box what depth tells is the thing in its middle.")
    silence: float = Field(
        default=0.25, ge=0, le=1, description="Weight of a pixel outside all boxes as a vote for no label."
    )


class Found(NamedTuple):
    """What a model says is there, by the model's own name."""

    name: str
    confidence: float
    box: tuple[float, float, float, float]
    """Left, top, right, bottom in pixels."""
    mask: Bool[np.ndarray, "H W"] | None = None
    """Its pixels where the model has them."""


class Detector(ABC):
    """A label source that finds things in photographs.

    Args:
        config: Thresholds.
        names: The model's names; those to ignore are left out of the vocabulary.
        model: What the model is, for the scene's record.
    """

    def __init__(self, config: DetectorConfig, names: Iterable[str], model: str) -> None:
        self._config = config
        self.vocabulary = tuple(dict.fromkeys(name for name in names if name not in config.ignore))
        self._numbers = {name: number for number, name in enumerate(self.vocabulary)}
        self.silence = config.silence
        self.description = f"{model}, confidence >= {config.least_confidence:g}"

    @abstractmethod
    def find(self, image: UInt8[np.ndarray, "H W 3"]) -> Iterable[Found]:
        """Return what the model sees in sRGB pixels, weak and unwanted things among it."""

    def detect(self, image: UInt8[np.ndarray, "H W 3"]) -> list[Detection]:
        """Return what is found in sRGB pixels, of the vocabulary and sure enough."""
        return [
            Detection(self._numbers[one.name], min(1.0, one.confidence), one.box, one.mask)
            for one in self.find(image)
            if one.name in self._numbers and one.confidence >= self._config.least_confidence
        ]

    def labels(self, frame: Frame) -> FrameLabels:
        """Return the labels of a frame, from its photograph, and its depth where both have one lens.

        Raises:
            InputError: The frame has no photograph.
        """
        return labels_of(frame, self.detect(frame.read_image()), depth=self._config.depth)
