"""YOLO models of random weights: boxes and masks become detections, and nothing in a file of weights is run."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.semantics.labels_2d.ultralytics_detector import QUIET, UltralyticsConfig
from schemas.errors import InputError

SIZE = (48, 64)
IMAGE = np.random.default_rng(0).integers(0, 255, (*SIZE, 3)).astype(np.uint8)


@pytest.fixture(scope="module", autouse=True)
def quiet(tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("YOLO_CONFIG_DIR", str(tmp_path_factory.mktemp("settings")))
        for name, value in QUIET.items():
            patch.setenv(name, value)
        pytest.importorskip("ultralytics")


def weights(architecture: str, folder: Path) -> str:
    """A model of random weights that takes all it sees for things of class 3."""
    import torch

    torch.manual_seed(0)
    model = import_module("ultralytics").YOLO(architecture)
    for branch in model.model.model[-1].cv3:
        branch[-1].bias.data[3] = 9.0
    file = folder / Path(architecture).with_suffix(".pt")
    model.save(file)
    return str(file)


@pytest.mark.parametrize(("architecture", "masks"), [("yolov8n.yaml", False), ("yolo11n-seg.yaml", True)])
def test_boxes_and_masks_are_found(architecture: str, masks: bool, tmp_path: Path) -> None:
    source = UltralyticsConfig(weights=weights(architecture, tmp_path), ignore=("0",)).open()
    found = source.detect(IMAGE)
    assert found
    for one in found:
        assert source.vocabulary[one.category] == "3"
        assert one.confidence >= 0.4
        assert (None if one.mask is None else one.mask.shape) == (SIZE if masks else None)


def test_names_for_a_model_with_classes_of_its_own_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected weights that ultralytics loads and that take names"):
        UltralyticsConfig(weights=weights("yolov8n.yaml", tmp_path), names=("chair",)).open()


class Nasty:
    """Writes a file when it is unpickled."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def __reduce__(self) -> tuple[object, tuple[str, ...]]:
        return os.mkdir, (str(self._file),)


def test_code_in_a_file_of_weights_is_not_run(tmp_path: Path) -> None:
    import torch

    file, trace = tmp_path / "nasty.pt", tmp_path / "trace"
    torch.save({"model": Nasty(trace)}, file)
    with pytest.raises(InputError, match="expected weights that ultralytics loads"):
        UltralyticsConfig(weights=str(file)).open()
    assert not trace.exists()


def test_a_file_that_is_no_model_is_refused(tmp_path: Path) -> None:
    for name in ("noise.pt", "noise.txt"):
        (tmp_path / name).write_bytes(b"no weights")
        with pytest.raises(InputError, match="expected weights that ultralytics loads"):
            UltralyticsConfig(weights=str(tmp_path / name)).open()
