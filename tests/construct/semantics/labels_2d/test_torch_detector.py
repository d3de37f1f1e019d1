"""Detectors of transformers and torchvision, of random weights: boxes of their own classes come out as labels."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.semantics.labels_2d.detector import Detector
from pipeline.construct.semantics.labels_2d.scene_frames import rendered_frames
from pipeline.construct.semantics.labels_2d.torch_detector import TorchDetectorConfig
from schemas.errors import InputError
from tests.construct.semantics.labels_2d.small_models import tokenizer_files
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


@pytest.fixture(scope="module")
def owl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("owl")
    ends = {"bos_token_id": 52, "eos_token_id": 53, "pad_token_id": 53}
    small = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 1, "num_attention_heads": 2}
    config = transformers.OwlViTConfig(
        text_config={**small, **ends, "vocab_size": 57, "max_position_embeddings": 16},
        vision_config={**small, "image_size": 32, "patch_size": 8},
        projection_dim=16,
    )
    transformers.OwlViTForObjectDetection(config).save_pretrained(folder)
    images = transformers.OwlViTImageProcessor(size={"height": 32, "width": 32})
    words = transformers.CLIPTokenizer(*tokenizer_files(folder), model_max_length=16)
    transformers.OwlViTProcessor(images, words).save_pretrained(folder)
    return folder


def labels_are_of_the_vocabulary(source: Detector, least: float) -> None:
    scene = tiny_scene()
    found = source.labels(rendered_frames(scene.gaussians, scene.views[:1])[0])
    assert found.category.shape == (36, 48)
    assert set(np.unique(found.category)) <= set(range(-1, len(source.vocabulary)))
    assert found.confidence is not None
    assert ((found.confidence >= least) == (found.category >= 0)).all()


def test_boxes_of_the_models_own_classes_become_labels(yolos: Path) -> None:
    source = TorchDetectorConfig(model=str(yolos), least_confidence=0.05, ignore=("table",), depth=False).open()
    assert source.vocabulary == ("chair",)
    labels_are_of_the_vocabulary(source, 0.05)


def test_a_model_that_takes_words_looks_for_the_names_given(owl: Path) -> None:
    source = TorchDetectorConfig(model=str(owl), names=("lamp", "a chair"), least_confidence=0.01, depth=False).open()
    assert source.vocabulary == ("lamp", "a chair")
    assert {one.category for one in source.detect(np.full((36, 48, 3), 90, np.uint8))} <= {0, 1}
    labels_are_of_the_vocabulary(source, 0.01)


def test_names_for_a_model_with_classes_of_its_own_are_refused(yolos: Path) -> None:
    with pytest.raises(InputError, match="a model that AutoModelForZeroShotObjectDetection loads"):
        TorchDetectorConfig(model=str(yolos), names=("chair",)).open()


def test_a_checkpoint_of_another_size_is_refused(yolos: Path, tmp_path: Path) -> None:
    for file in yolos.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    config = json.loads((tmp_path / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps({**config, "hidden_size": 32}))
    with pytest.raises(InputError, match="a model that AutoModelForObjectDetection loads"):
        TorchDetectorConfig(model=str(tmp_path)).open()
    (tmp_path / "model.safetensors").write_bytes(b"no tensors")
    with pytest.raises(InputError, match="a model that AutoModelForObjectDetection loads"):
        TorchDetectorConfig(model=str(tmp_path)).open()


def test_boxes_of_torchvision_become_labels(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    detection = pytest.importorskip("torchvision.models.detection")
    torch.manual_seed(0)
    architecture, file = "ssdlite320_mobilenet_v3_large", tmp_path / "ssdlite.pth"
    torch.save(getattr(detection, architecture)(weights=None, weights_backbone=None, num_classes=91).state_dict(), file)
    source = TorchDetectorConfig(model=f"torchvision:{architecture}:{file}", least_confidence=0.01, depth=False).open()
    assert source.detect(np.full((36, 48, 3), 90, np.uint8))
    labels_are_of_the_vocabulary(source, 0.01)
    with pytest.raises(InputError, match="expected a state dict of fasterrcnn_mobilenet_v3_large_320_fpn"):
        TorchDetectorConfig(model=f"torchvision:fasterrcnn_mobilenet_v3_large_320_fpn:{file}").open()
