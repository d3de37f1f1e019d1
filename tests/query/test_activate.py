from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from pipeline.query import activate as activation
from pipeline.query.activate import ActivationConfig, activate, cosine_similarity, relevancy
from pipeline.scene.semantics import Semantics
from schemas.errors import InputError

RNG = np.random.default_rng(3)


class Encoder:
    """Fixed directions by text."""

    def __init__(self, **directions: Sequence[float]) -> None:
        self.directions = directions

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        return np.array([self.directions[text] for text in texts], np.float32)


ENCODER = Encoder(
    chair=(2, 0, 0, 0),
    lamp=(0, 3, 0, 0),
    object=(1, 1, 1, 0),
    things=(0, 0, 1, 0),
    stuff=(0, 0, 1, 1),
    texture=(0, 0, 0, 1),
)


def _embedded(rows: list[list[float]]) -> Semantics:
    features = np.array(rows, np.float32)
    norms = np.linalg.norm(features, axis=1, keepdims=True)
    return Semantics(("chair", "lamp"), embedding=features / np.where(norms == 0, 1, norms))


def test_labels_activate_exactly_the_gaussians_that_carry_the_name() -> None:
    category = RNG.integers(-1, 3, 50).astype(np.int32)
    found = activate(Semantics(("a", "b", "c"), category), "b", ActivationConfig())
    assert found.category == "b"
    assert found.ids.dtype == np.int32
    assert found.ids.tolist() == [j for j in range(50) if category[j] == 1]


def test_cosine_activates_from_the_threshold_up() -> None:
    semantics = _embedded([[1, 0, 0, 0], [1, 1, 0, 0], [1, 2, 0, 0], [0.5, 0, 0, 3**0.5 / 2], [-1, 0, 0, 0], [0] * 4])
    config = ActivationConfig(by="cosine")
    similarity = cosine_similarity(semantics.embedding, ENCODER.encode(["chair"]))[:, 0]
    np.testing.assert_allclose(similarity, [1, 0.5**0.5, 0.2**0.5, 0.5, -1, 0], atol=1e-6)
    assert activate(semantics, "chair", config, ENCODER).ids.tolist() == [0, 1, 3]
    assert activate(semantics, "lamp", config, ENCODER).ids.tolist() == [1, 2]


def test_relevancy_is_the_least_softmax_against_any_canonical_phrase() -> None:
    positive, canonical = RNG.uniform(-1, 1, 40), RNG.uniform(-1, 1, (40, 4))
    pairs = np.exp(10 * positive)[:, None] / (np.exp(10 * positive)[:, None] + np.exp(10 * canonical))
    np.testing.assert_allclose(relevancy(positive, canonical, 10.0), pairs.min(axis=1), rtol=1e-12)


def test_relevancy_activates_what_beats_every_canonical_phrase() -> None:
    semantics = _embedded([[1, 0, 0, 0], [0, 0, 1, 0], [1, 1, 1, 0], [0] * 4])
    assert activate(semantics, "chair", ActivationConfig(by="relevancy"), ENCODER).ids.tolist() == [0]


@pytest.mark.parametrize("by", ["cosine", "relevancy"])
def test_unlabelled_rows_are_never_activated(by: str) -> None:
    semantics = _embedded([[0] * 4, [1, 0, 0, 0]])
    config = ActivationConfig(by=by, threshold=-1.0)
    assert activate(semantics, "chair", config, ENCODER).ids.tolist() == [1]


def test_embeddings_compared_in_pieces_give_the_same_similarities(monkeypatch: pytest.MonkeyPatch) -> None:
    features, text = RNG.normal(size=(50, 8)).astype(np.float16), RNG.normal(size=(3, 8)).astype(np.float32)
    whole = cosine_similarity(features, text)
    monkeypatch.setattr(activation, "ROWS_AT_ONCE", 7)
    np.testing.assert_allclose(cosine_similarity(features, text), whole, rtol=1e-5, atol=1e-6)


class TestErrors:
    def test_unknown_category_is_named(self) -> None:
        with pytest.raises(InputError, match="'sofa'"):
            activate(Semantics(("a",), np.zeros(3, np.int32)), "sofa", ActivationConfig())

    def test_labels_of_a_scene_with_embeddings_only(self) -> None:
        with pytest.raises(InputError, match="category"):
            activate(_embedded([[1, 0, 0, 0]]), "chair", ActivationConfig())

    def test_embeddings_of_a_scene_with_labels_only(self) -> None:
        with pytest.raises(InputError, match="embedding"):
            activate(Semantics(("a",), np.zeros(3, np.int32)), "a", ActivationConfig(by="cosine"), ENCODER)

    def test_embeddings_without_an_encoder(self) -> None:
        with pytest.raises(InputError, match="text_embeddings"):
            activate(_embedded([[1, 0, 0, 0]]), "chair", ActivationConfig(by="cosine"))

    def test_an_encoder_of_another_feature_space(self) -> None:
        with pytest.raises(InputError, match="size 4"):
            cosine_similarity(np.ones((2, 4), np.float32), np.ones((1, 3), np.float32))
