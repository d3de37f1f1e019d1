"""Detectors of the transformers library by local folder or hub name, and of torchvision by a local file.

Anything `AutoModelForObjectDetection` loads will do (DETR, RT-DETR, YOLOS, ...); its own configuration names the
classes. With `names`, a model that takes names in words (OWL-ViT, OWLv2, Grounding DINO) looks for those. A checkpoint
of torchvision is taken by `torchvision:ARCHITECTURE:FILE`, with COCO's classes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8
from pydantic import Field

from pipeline.construct.semantics.labels_2d.coco import COCO_NAMES
from pipeline.construct.semantics.labels_2d.detector import Detector, DetectorConfig, Found
from pipeline.construct.semantics.labels_2d.torch_models import load_pretrained, require
from schemas.errors import InputError

TORCHVISION = "torchvision:"


class TorchDetectorConfig(DetectorConfig):
    """A detector and its thresholds."""

    kind: Literal["torch_detector"] = "torch_detector"
    model: str = Field(
        description="Local folder or hub name of a transformers detector, or torchvision:ARCHITECTURE:FILE with the "
        "state dict of a torchvision detector trained on COCO."
    )
    names: tuple[str, ...] = Field(
        default=(),
        description="Names to look for (OWL-ViT, OWLv2, Grounding DINO); empty asks for the model's classes.",
    )
    device: str = Field(default="cpu", description="Torch device.")

    def open(self, scene: str = "") -> Detector:
        """Return the detector, loaded; the scene's name is not needed.

        Raises:
            InputError: A library is missing, or the model cannot be loaded.
        """
        if self.model.startswith(TORCHVISION):
            return TorchvisionDetector(self)
        return NamedDetector(self) if self.names else TransformersDetector(self)


class TransformersDetector(Detector):
    """A model of the transformers library with classes of its own."""

    def __init__(self, config: TorchDetectorConfig) -> None:
        self._model: Any = load_pretrained("AutoModelForObjectDetection", config.model).to(config.device).eval()
        self._looks: Any = load_pretrained("AutoImageProcessor", config.model)
        self._device = config.device
        self._names = {int(key): str(name) for key, name in sorted(self._model.config.id2label.items())}
        super().__init__(config, self._names.values(), config.model)

    def find(self, image: UInt8[np.ndarray, "H W 3"]) -> Iterator[Found]:
        """Return what the model sees in sRGB pixels."""
        with require("torch").inference_mode():
            inputs = self._looks(images=image, return_tensors="pt").to(self._device)
            found = self._looks.post_process_object_detection(
                self._model(**inputs), threshold=self._config.least_confidence, target_sizes=[image.shape[:2]]
            )[0]
        return rows_of(found, self._names)


class NamedDetector(Detector):
    """A model of the transformers library that looks for what it is told in words."""

    def __init__(self, config: TorchDetectorConfig) -> None:
        self._model: Any = load_pretrained("AutoModelForZeroShotObjectDetection", config.model)
        self._model.to(config.device).eval()
        self._looks: Any = load_pretrained("AutoProcessor", config.model)
        self._device, self._names = config.device, list(config.names)
        super().__init__(config, config.names, config.model)

    def find(self, image: UInt8[np.ndarray, "H W 3"]) -> Iterator[Found]:
        """Return what the model sees in sRGB pixels."""
        with require("torch").inference_mode():
            inputs = self._looks(images=image, text=[self._names], return_tensors="pt").to(self._device)
            found = self._looks.post_process_grounded_object_detection(
                self._model(**inputs),
                threshold=self._config.least_confidence,
                target_sizes=[image.shape[:2]],
                text_labels=[self._names],
            )[0]
        rows = zip(found["text_labels"], found["scores"].tolist(), found["boxes"].tolist(), strict=True)
        return (Found(name, score, (left, top, right, bottom)) for name, score, (left, top, right, bottom) in rows)


class TorchvisionDetector(Detector):
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
        super().__init__(config, COCO_NAMES.values(), config.model)

    def find(self, image: UInt8[np.ndarray, "H W 3"]) -> Iterator[Found]:
        """Return what the model sees in sRGB pixels."""
        torch = require("torch")
        pixels = torch.from_numpy(image.copy()).permute(2, 0, 1).float().div(255).to(self._device)
        with torch.inference_mode():
            return rows_of(self._model([pixels])[0], COCO_NAMES)


def rows_of(found: Mapping[str, Any], names: Mapping[int, str]) -> Iterator[Found]:
    """Return the detections that both libraries give as tensors of labels, scores and boxes; Mask R-CNN adds masks."""
    columns = (found[key].tolist() for key in ("labels", "scores", "boxes"))
    masks = (found["masks"][:, 0] > 0.5).cpu().numpy() if "masks" in found else None
    for row, (label, score, (left, top, right, bottom)) in enumerate(zip(*columns, strict=True)):
        mask = None if masks is None else masks[row]
        yield Found(names.get(label, ""), score, (left, top, right, bottom), mask)
