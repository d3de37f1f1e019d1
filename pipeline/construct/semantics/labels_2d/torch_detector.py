"""Detectors of the transformers library by local folder or hub name: DETR, RT-DETR, OWL-style heads are not asked.

Anything `AutoModelForObjectDetection` loads will do; its own configuration names the classes. A checkpoint of
torchvision is taken by `torchvision:ARCHITECTURE:FILE`, with COCO's classes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8
from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.labels_2d.boxes import Detection, labels_of
from pipeline.construct.semantics.labels_2d.coco import COCO_NAMES
from pipeline.construct.semantics.labels_2d.source import FrameLabels
from pipeline.construct.semantics.labels_2d.torch_models import load_pretrained, require
from pipeline.scene.captures import Frame
from schemas.errors import InputError

TORCHVISION = "torchvision:"


class TorchDetectorConfig(BaseModel):
    """A detector and its thresholds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["torch_detector"] = "torch_detector"
    model: str = Field(
        description="Local folder or hub name of a transformers detector, or torchvision:ARCHITECTURE:FILE with the "
        "state dict of a torchvision detector trained on COCO."
    )
    device: str = Field(default="cpu", description="Torch device.")
    least_confidence: float = Field(default=0.4, gt=0, le=1, description="Detections under this are dropped.")
    ignore: tuple[str, ...] = Field(default=("person",), description="Names left out.")
    depth: bool = Field(default=True, description="Keep of each box what depth tells is the thing in its middle.")
    silence: float = Field(
        default=0.25, ge=0, le=1, description="Weight of a pixel outside all boxes as a vote for no label."
    )

    def open(self, scene: str = "") -> TorchDetector:
        """Return the detector, loaded; the scene's name is not needed.

        Raises:
            InputError: A library is missing, or the model cannot be loaded.
        """
        return TorchDetector(self)


class TorchDetector:
    """Asks a torch model what photographs show."""

    def __init__(self, config: TorchDetectorConfig) -> None:
        self.config = config
        if config.model.startswith(TORCHVISION):
            self._detector: _Torchvision | _Transformers = _Torchvision(config)
        else:
            self._detector = _Transformers(config)
        names = dict(sorted(self._detector.names.items()))
        self.vocabulary = tuple(dict.fromkeys(name for name in names.values() if name not in config.ignore))
        self.silence = config.silence
        self.description = f"{config.model}, confidence >= {config.least_confidence:g}"

    def labels(self, frame: Frame) -> FrameLabels:
        """Return the labels of a frame, from its photograph, and its depth where both have one lens.

        Raises:
            InputError: The frame has no photograph.
        """
        found = []
        for name, confidence, box in self._detector.detect(frame.read_image()):
            if name in self.vocabulary and confidence >= self.config.least_confidence:
                left, top, right, bottom = box
                sure = min(1.0, confidence)
                found.append(Detection(self.vocabulary.index(name), sure, (left, top, right, bottom)))
        return labels_of(frame, found, depth=self.config.depth)


class _Transformers:
    """A model of the transformers library."""

    def __init__(self, config: TorchDetectorConfig) -> None:
        self._model: Any = load_pretrained("AutoModelForObjectDetection", config.model).to(config.device).eval()
        self._looks: Any = load_pretrained("AutoImageProcessor", config.model)
        self._device, self._least = config.device, config.least_confidence
        self.names: Mapping[int, str] = {int(key): str(name) for key, name in self._model.config.id2label.items()}

    def detect(self, image: UInt8[np.ndarray, "H W 3"]) -> list[tuple[str, float, list[float]]]:
        torch = require("torch")
        with torch.inference_mode():
            inputs = self._looks(images=image, return_tensors="pt").to(self._device)
            found = self._looks.post_process_object_detection(
                self._model(**inputs), threshold=self._least, target_sizes=[image.shape[:2]]
            )[0]
        rows = zip(found["labels"].tolist(), found["scores"].tolist(), found["boxes"].tolist(), strict=True)
        return [(self.names.get(label, ""), score, box) for label, score, box in rows]


class _Torchvision:
    """A model of torchvision from a local state dict; nothing is downloaded and nothing unpickled but tensors."""

    def __init__(self, config: TorchDetectorConfig) -> None:
        torch, detection = require("torch"), require("torchvision.models.detection")
        architecture, _, file = config.model.removeprefix(TORCHVISION).partition(":")
        build = getattr(detection, architecture, None)
        if not architecture or not callable(build) or not file:
            expected = f"{TORCHVISION}ARCHITECTURE:FILE with an architecture of torchvision.models.detection"
            raise InputError("torch_detector", field="model", expected=expected, found=config.model)
        self._model: Any = build(weights=None, weights_backbone=None, num_classes=max(COCO_NAMES) + 1)
        try:
            self._model.load_state_dict(torch.load(file, map_location="cpu", weights_only=True))
        except (OSError, RuntimeError, ValueError, EOFError) as error:
            first = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise InputError(file, expected=f"a state dict of {architecture}", found=first) from error
        self._model.to(config.device).eval()
        self._device = config.device
        self.names: Mapping[int, str] = COCO_NAMES

    def detect(self, image: UInt8[np.ndarray, "H W 3"]) -> list[tuple[str, float, list[float]]]:
        torch = require("torch")
        pixels = torch.from_numpy(image.copy()).permute(2, 0, 1).float().div(255).to(self._device)
        with torch.inference_mode():
            found = self._model([pixels])[0]
        rows = zip(found["labels"].tolist(), found["scores"].tolist(), found["boxes"].tolist(), strict=True)
        return [(self.names.get(label, ""), score, box) for label, score, box in rows]
