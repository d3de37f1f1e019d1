"""A detector of the transformers library, of random weights: boxes of its own classes come out as labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.semantics.labels_2d.scene_frames import rendered_frames
from pipeline.construct.semantics.labels_2d.torch_detector import TorchDetectorConfig
from tests.query.tiny import tiny_scene

transformers = pytest.importorskip("transformers")


@pytest.fixture(scope="module")
def yolos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("yolos")
    config = transformers.YolosConfig(
        hidden_size=16,
        num_hidden_layers=1,
        num_attention_heads=2,
        intermediate_size=32,
        image_size=[32, 32],
        patch_size=8,
        num_detection_tokens=6,
        id2label={0: "chair", 1: "table"},
        label2id={"chair": 0, "table": 1},
    )
    transformers.YolosForObjectDetection(config).save_pretrained(folder)
    transformers.YolosImageProcessor(size={"height": 32, "width": 32}).save_pretrained(folder)
    return folder


def test_boxes_of_the_models_own_classes_become_labels(yolos: Path) -> None:
    scene = tiny_scene()
    source = TorchDetectorConfig(model=str(yolos), least_confidence=0.05, ignore=("table",), depth=False).open()
    assert source.vocabulary == ("chair",)
    found = source.labels(rendered_frames(scene.gaussians, scene.views[:1])[0])
    assert found.category.shape == (36, 48)
    assert set(np.unique(found.category)) <= {-1, 0}
    assert found.confidence is not None
    assert ((found.confidence >= 0.05) == (found.category == 0)).all()
