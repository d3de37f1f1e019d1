"""Text embeddings beside a scene: round trip, use by the method, and what is refused."""

from __future__ import annotations

import dataclasses
import io
import pickle
from pathlib import Path

import numpy as np
import pytest

from pipeline.config import MethodConfig
from pipeline.query.activate import ActivationConfig
from pipeline.scene.load import load_scene
from pipeline.scene.save import save_scene
from pipeline.scene.semantics import Semantics
from pipeline.scene.text_embeddings import FILE, TextEmbeddings, read_text_embeddings
from pipeline.tasks.context import SceneContext
from schemas.errors import InputError
from tests.query.tiny import tiny_scene

TEXTS = TextEmbeddings(("chair", "lamp"), np.array([[2, 0, 0], [0, 1, 1]], np.float32))


def test_a_saved_scene_brings_its_embeddings_and_is_searched_by_them(tmp_path: Path) -> None:
    scene = tiny_scene()
    rng = np.random.default_rng(0)
    features = np.zeros((len(scene.gaussians), 3), np.float32)
    features[rng.permutation(len(features))[: len(features) // 3], 0] = 1
    semantics = Semantics(("chair", "lamp"), embedding=features)
    save_scene(dataclasses.replace(scene, semantics=semantics, texts=TEXTS), str(tmp_path / "scene"))
    loaded = load_scene(str(tmp_path / "scene"))
    assert loaded.texts is not None
    assert loaded.texts.names == TEXTS.names
    np.testing.assert_array_equal(loaded.texts.vectors, TEXTS.vectors)
    config = MethodConfig(activation=ActivationConfig(by="cosine"))
    found = SceneContext(loaded).activation("chair", config.activation)
    np.testing.assert_array_equal(found.ids, np.flatnonzero(features[:, 0]))
    assert SceneContext(loaded).clusters("chair", config)


def test_saving_a_scene_without_embeddings_removes_those_of_an_earlier_one(tmp_path: Path) -> None:
    save_scene(dataclasses.replace(tiny_scene(), texts=TEXTS), str(tmp_path))
    save_scene(tiny_scene(), str(tmp_path))
    assert load_scene(str(tmp_path)).texts is None


def test_a_name_without_a_vector_is_named() -> None:
    with pytest.raises(InputError, match="'sofa'"):
        TEXTS.encode(["chair", "sofa"])


@pytest.mark.parametrize(
    ("names", "vectors", "message"),
    [
        (["a", "a"], np.ones((2, 3), np.float32), "distinct"),
        (["a", "b"], np.ones((1, 3), np.float32), "one vector"),
        (["a", "b"], np.array([[1, 0], [0, 0]], np.float32), "b: expected a finite vector"),
        (["a"], np.array([[np.nan, 1]], np.float32), "a: expected a finite vector"),
        (["a"], np.ones((1, 3), np.int32), "floats"),
        (["a"], np.ones(3, np.float32), "T x D"),
    ],
)
def test_unusable_content_is_refused(tmp_path: Path, names: list[str], vectors: np.ndarray, message: str) -> None:
    np.savez(tmp_path / FILE, names=np.array(names), vectors=vectors)
    with pytest.raises(InputError, match=message):
        read_text_embeddings(str(tmp_path / FILE))


def test_bytes_that_are_no_npz_and_pickles_are_refused(tmp_path: Path) -> None:
    objects = io.BytesIO()
    np.savez(objects, names=np.array(["a"], object), vectors=np.ones((1, 2), np.float32))
    for data in (b"", b"PK\x03\x04 cut", pickle.dumps({"names": ["a"]}), objects.getvalue()):
        (tmp_path / FILE).write_bytes(data)
        with pytest.raises(InputError, match="NPZ"):
            read_text_embeddings(str(tmp_path / FILE))
