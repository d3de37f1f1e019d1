"""YOLO models through the ultralytics package, which users install themselves: its licence is AGPL-3.0.

Detection and segmentation weights both work; masks are used where the model has them. YOLO-World and YOLOE weights take
the names they are to look for (3D-Mem detects with YOLOv8x-World).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8
from pydantic import Field

from pipeline.construct.semantics.labels_2d.detector import Detector, DetectorConfig, Found
from pipeline.construct.semantics.labels_2d.torch_models import require
from schemas.errors import InputError

EXTRA = "pip install ultralytics; its licence is AGPL-3.0"
QUIET = {"ULTRALYTICS_SAFE_LOAD": "true", "YOLO_AUTOINSTALL": "false", "YOLO_OFFLINE": "true"}
"""Set before the package is imported, unless the user has: weights are pickles, which it would else run whole, install
what they ask for, and report its use to its makers."""


class UltralyticsConfig(DetectorConfig):
    """The weights and thresholds."""

    kind: Literal["ultralytics"] = "ultralytics"
    weights: str = Field(description="Local file of weights.")
    names: tuple[str, ...] = Field(
        default=(), description="Names to look for (YOLO-World, YOLOE); empty keeps the model's."
    )
    device: str = Field(default="cpu", description="Torch device.")

    def open(self, scene: str = "") -> UltralyticsDetector:
        """Return the detector, loaded; the scene's name is not needed.

        Raises:
            InputError: The package is missing, the weights are, or they take no names.
        """
        return UltralyticsDetector(self)


class UltralyticsDetector(Detector):
    """Asks a YOLO model what photographs show."""

    def __init__(self, config: UltralyticsConfig) -> None:
        if not Path(config.weights).is_file():  # else the package downloads what it thinks was meant
            raise InputError(config.weights, expected="a local file of weights", found="none")
        for name, value in QUIET.items():
            os.environ.setdefault(name, value)
        library = require("ultralytics", EXTRA)
        try:
            self._model: Any = library.YOLO(config.weights)
            if config.names:
                self._model.set_classes(list(config.names))
            self._names: dict[int, str] = dict(self._model.names)
        except (OSError, RuntimeError, TypeError, ValueError, AttributeError, AssertionError, ImportError) as error:
            first = (str(error).strip().splitlines() or [type(error).__name__])[0]
            expected = "weights that ultralytics loads" + (" and that take names" if config.names else "")
            raise InputError(config.weights, expected=expected, found=first) from error
        self._device = config.device
        super().__init__(config, self._names.values(), f"ultralytics {Path(config.weights).name}")

    def find(self, image: UInt8[np.ndarray, "H W 3"]) -> Iterator[Found]:
        """Return what the model sees in sRGB pixels."""
        bgr = np.ascontiguousarray(image[..., ::-1])  # the package takes arrays as OpenCV has them
        result = self._model.predict(
            bgr, conf=self._config.least_confidence, device=self._device, retina_masks=True, verbose=False
        )[0]
        masks = None if result.masks is None else result.masks.data.cpu().numpy() > 0.5
        columns = (column.tolist() for column in (result.boxes.cls, result.boxes.conf, result.boxes.xyxy))
        for row, (label, sure, (left, top, right, bottom)) in enumerate(zip(*columns, strict=True)):
            mask = None if masks is None else masks[row]
            yield Found(self._names[int(label)], sure, (left, top, right, bottom), mask)
