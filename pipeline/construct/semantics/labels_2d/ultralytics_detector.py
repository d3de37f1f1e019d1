"""YOLO models through the ultralytics package, which users install themselves: its licence is AGPL-3.0.

Detection and segmentation weights both work; masks are used where the model has them. YOLO-World weights take the
names they are to look for (3D-Mem detects with YOLOv8x-World).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8
from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.labels_2d.boxes import Detection, labels_of
from pipeline.construct.semantics.labels_2d.source import FrameLabels
from pipeline.construct.semantics.labels_2d.torch_models import require
from pipeline.scene.captures import Frame
from schemas.errors import InputError

EXTRA = "pip install ultralytics; its licence is AGPL-3.0"


class UltralyticsConfig(BaseModel):
    """The weights and thresholds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["ultralytics"] = "ultralytics"
    weights: str = Field(description="Local file of weights.")
    names: tuple[str, ...] = Field(default=(), description="Names to look for (YOLO-World); empty keeps the model's.")
    device: str = Field(default="cpu", description="Torch device.")
    least_confidence: float = Field(default=0.4, gt=0, le=1, description="Detections under this are dropped.")
    ignore: tuple[str, ...] = Field(default=("person",), description="Names left out.")
    depth: bool = Field(default=True, description="Keep of each box what depth tells is the thing in its middle.")
    silence: float = Field(
        default=0.25, ge=0, le=1, description="Weight of a pixel outside all boxes as a vote for no label."
    )

    def open(self, scene: str = "") -> UltralyticsDetector:
        """Return the detector, loaded; the scene's name is not needed.

        Raises:
            InputError: The package is missing, or the weights are.
        """
        return UltralyticsDetector(self)


class UltralyticsDetector:
    """Asks a YOLO model what photographs show."""

    def __init__(self, config: UltralyticsConfig) -> None:
        if not Path(config.weights).is_file():  # else the package downloads what it thinks was meant
            raise InputError(config.weights, expected="a local file of weights", found="none")
        self.config = config
        self._model: Any = require("ultralytics", EXTRA).YOLO(config.weights)
        if config.names:
            self._model.set_classes(list(config.names))
        self._names = {int(key): str(name) for key, name in self._model.names.items()}
        self.vocabulary = tuple(dict.fromkeys(name for name in self._names.values() if name not in config.ignore))
        self.silence = config.silence
        self.description = f"ultralytics {Path(config.weights).name}, confidence >= {config.least_confidence:g}"

    def detect(self, image: UInt8[np.ndarray, "H W 3"]) -> list[Detection]:
        """Return what is found in sRGB pixels."""
        bgr = np.ascontiguousarray(image[..., ::-1])  # the package takes arrays as OpenCV has them
        result = self._model.predict(
            bgr, conf=self.config.least_confidence, device=self.config.device, retina_masks=True, verbose=False
        )[0]
        masks = None if result.masks is None else result.masks.data.cpu().numpy() > 0.5
        found = []
        for row in range(len(result.boxes)):
            name = self._names[int(result.boxes.cls[row])]
            if name in self.vocabulary:
                left, top, right, bottom = (float(edge) for edge in result.boxes.xyxy[row])
                sure = min(1.0, float(result.boxes.conf[row]))
                mask = None if masks is None else masks[row]
                found.append(Detection(self.vocabulary.index(name), sure, (left, top, right, bottom), mask))
        return found

    def labels(self, frame: Frame) -> FrameLabels:
        """Return the labels of a frame, from its photograph, and its depth where the model has no masks.

        Raises:
            InputError: The frame has no photograph.
        """
        return labels_of(frame, self.detect(frame.read_image()), depth=self.config.depth)
