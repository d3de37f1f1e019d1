"""Adapters whose libraries or weights are missing say what to install or give."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.construct.semantics.labels_2d.torch_detector import TorchDetectorConfig
from pipeline.construct.semantics.labels_2d.torch_models import load_pretrained, require
from pipeline.construct.semantics.labels_2d.ultralytics_detector import UltralyticsConfig
from schemas.errors import InputError


def test_a_missing_library_is_named() -> None:
    with pytest.raises(InputError, match=r"no_such_library: expected an installed module \(pip install"):
        require("no_such_library")


def test_a_missing_model_is_named(tmp_path: Path) -> None:
    pytest.importorskip("transformers")
    with pytest.raises(InputError, match="expected a model that CLIPModel loads"):
        load_pretrained("CLIPModel", str(tmp_path))
    with pytest.raises(InputError, match="a model that CLIPModel loads, found no such folder"):
        load_pretrained("CLIPModel", str(tmp_path / "clip"))


def test_missing_yolo_weights_are_not_downloaded(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"yolov8x.pt: expected a local file of weights"):
        UltralyticsConfig(weights=str(tmp_path / "yolov8x.pt")).open()


def test_a_torchvision_detector_needs_architecture_and_file() -> None:
    pytest.importorskip("torchvision")
    with pytest.raises(InputError, match="expected torchvision:ARCHITECTURE:FILE"):
        TorchDetectorConfig(model="torchvision:nothing").open()
