"""Language fields: their rules against a hand computation, files of others, and scores like everyone's."""

from __future__ import annotations

import asyncio
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.baselines.config import CategoryFieldConfig, ScoresFieldConfig, SentenceFieldConfig
from pipeline.baselines.field_file import read_field
from pipeline.baselines.registry import answer_question
from pipeline.metrics.instance_iou import instance_iou
from pipeline.metrics.iou import weighted_iou
from pipeline.scene.scene import Scene
from pipeline.scene.semantics import Semantics
from pipeline.scene.text_embeddings import TextEmbeddings, text_embeddings_npz
from pipeline.tasks.method import QuestionRows, SceneContext
from schemas.errors import InputError
from schemas.questions import Question, Task
from tests.query.tiny import Scripted, caller_of, gaussians_at, tiny_scene

FEATURES = np.array([[1, 0, 0], [0.6, 0.8, 0], [0, 1, 0], [0, 0.6, 0.8], [0, 0, 0]], np.float32)
"""Five Gaussians; the last is unlabelled."""
TEXTS = {
    "the chair": (1, 0, 0),
    "chair": (1, 0, 0),
    **{"object": (0, 0, 1), "things": (0, 1, 0), "stuff": (0, 0.8, 0.6), "texture": (0, 0.1, 1)},
}
SENTENCE = "the chair"


def _texts() -> TextEmbeddings:
    return TextEmbeddings(tuple(TEXTS), np.array(list(TEXTS.values()), np.float32))


def _five(texts: TextEmbeddings | None = None) -> Scene:
    base = tiny_scene()
    means = np.array([[x, 2.0, 0.4] for x in (-1.5, -1.4, 1.4, 1.5, 3.0)])
    instance = np.array([0, 0, 1, 1, 1], np.int32)
    semantics = Semantics(("chair",), None, FEATURES, instance)
    return Scene("five", gaussians_at(means), base.views, semantics, base.up, texts or _texts())


def _ask(
    config: Any, scene: Scene, task: Task = "ground_one", targets: tuple[int, ...] | None = (0,), text: str = SENTENCE
) -> QuestionRows:
    question = Question("q1", scene.name, task, text, target_ids=targets)
    return asyncio.run(answer_question(SceneContext(scene), question, caller_of(Scripted({})), config))


def _by_hand(threshold: float) -> tuple[int, ...]:
    """LERF relevancy, one Gaussian and one canonical phrase at a time."""
    found = []
    for number, feature in enumerate(FEATURES):
        if not feature.any():
            continue

        def cosine(name: str, feature: np.ndarray = feature) -> float:
            vector = np.array(TEXTS[name], float)
            return float(feature @ vector / np.linalg.norm(vector))

        shares = []
        for phrase in ("object", "things", "stuff", "texture"):
            positive, negative = math.exp(10 * cosine(SENTENCE)), math.exp(10 * cosine(phrase))
            shares.append(positive / (positive + negative))
        if min(shares) > threshold:
            found.append(number)
    return tuple(found)


@pytest.mark.parametrize("threshold", [0.05, 0.5, 0.9])
def test_sentence_field_by_relevancy_is_the_hand_computation(threshold: float) -> None:
    rows = _ask(SentenceFieldConfig(threshold=threshold), _five())
    assert rows.regions[0].gaussians == _by_hand(threshold)
    assert len({_by_hand(value) for value in (0.05, 0.5, 0.9)}) > 1


@pytest.mark.parametrize(("threshold", "ids"), [(0.5, (0, 1)), (0.6001, (0,)), (-1.0, (0, 1, 2, 3))])
def test_sentence_field_by_cosine_takes_at_least_the_threshold(threshold: float, ids: tuple[int, ...]) -> None:
    rows = _ask(SentenceFieldConfig(by="cosine", threshold=threshold), _five())
    assert rows.regions[0].gaussians == ids


def test_category_field_searches_the_evidence_and_not_the_sentence() -> None:
    rows = _ask(CategoryFieldConfig(by="cosine"), _five(), text="find it, please")
    assert rows.answers[0].evidence == ("chair",)
    assert rows.regions[0].gaussians == (0, 1)
    assert [call.stage for call in rows.calls] == ["evidence"]


def test_texts_may_come_from_a_file_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "five.npz").write_bytes(text_embeddings_npz(_texts()))
    scene = dataclasses.replace(_five(), texts=None)
    rows = _ask(SentenceFieldConfig(texts=str(tmp_path / "{scene}.npz")), scene)
    assert rows.regions[0].gaussians == _by_hand(0.5)
    with pytest.raises(InputError, match=r"five: texts: expected text_embeddings.npz or `texts`, found neither"):
        _ask(SentenceFieldConfig(), scene)
    with pytest.raises(InputError, match="expected the name 'another'"):
        _ask(SentenceFieldConfig(texts=str(tmp_path / "{scene}.npz")), scene, text="another")


class TestStandIn:
    @pytest.mark.parametrize(
        ("by", "text", "instances"),
        [
            ("cosine", "the chair", {0, 1, 4}),
            ("cosine", "the chair next to the table", {0, 1, 2, 4}),
            ("relevancy", "the table", {2}),
            ("relevancy", "a purple owl", set()),
        ],
    )
    def test_a_sentence_lies_between_the_categories_it_names(self, by: Any, text: str, instances: set[int]) -> None:
        scene = tiny_scene()
        rows = _ask(SentenceFieldConfig(features="symbolic", by=by), scene, text=text)
        ids = [number for region in rows.regions for number in region.gaussians]
        assert set(scene.semantics.instance[ids].tolist()) == instances
        assert rows.answers[0].model == "symbolic field"

    def test_a_category_is_its_gaussians(self) -> None:
        rows = _ask(CategoryFieldConfig(features="symbolic"), tiny_scene())
        assert rows.answers[0].evidence == ("chair",)
        assert rows.answers[0].model == "script, symbolic field"
        assert set(tiny_scene().semantics.instance[list(rows.regions[0].gaussians)].tolist()) == {0, 1, 4}

    def test_a_scene_without_labels_has_none(self) -> None:
        with pytest.raises(InputError, match="five: category: expected one per Gaussian"):
            _ask(SentenceFieldConfig(features="symbolic"), _five())


def test_regions_are_scored_like_those_of_any_method() -> None:
    scene = _five()
    weights = SceneContext(scene).weights("percentile")
    one = _ask(SentenceFieldConfig(by="cosine"), scene)
    found = np.array([0, 1], np.int32)
    assert one.arms[0].iou == weighted_iou(found, np.array([0, 1]), weights)
    assert (one.arms[0].predicted, one.arms[0].targets, one.arms[0].region_gaussians) == (1, 1, 2)
    many = _ask(SentenceFieldConfig(by="cosine", threshold=-1.0), scene, "ground_many", (0, 1))
    truth = [np.flatnonzero(scene.semantics.instance == number) for number in (0, 1)]
    expected = instance_iou([np.arange(4)], truth, weights)
    assert many.arms[0].iou == expected.score
    assert many.arms[0].pair_ious == tuple(pair[2] for pair in expected.pairs)


def test_several_targets_may_be_told_apart_by_clusters() -> None:
    scene = tiny_scene()
    features = np.eye(4, dtype=np.float32)[scene.semantics.category]
    texts = TextEmbeddings(("all chairs",), np.eye(4, dtype=np.float32)[:1])
    scene = dataclasses.replace(scene, semantics=dataclasses.replace(scene.semantics, embedding=features), texts=texts)
    for instances, count in (("one", 1), ("clusters", 3)):
        config = SentenceFieldConfig(by="cosine", instances=instances)
        rows = _ask(config, scene, "ground_many", (0, 1, 4), "all chairs")
        assert rows.arms[0].predicted == len(rows.regions) == count
    assert rows.arms[0].iou == pytest.approx(1.0)


def test_nothing_found_predicts_no_instance() -> None:
    rows = _ask(SentenceFieldConfig(by="cosine", threshold=1.0), _five(), "ground_many", (), "object")
    assert (rows.arms[0].predicted, rows.arms[0].iou, rows.regions) == (0, 1.0, ())


def test_no_evidence_for_several_targets_is_an_answer() -> None:
    question = Question("q1", "five", "ground_many", SENTENCE, target_ids=())
    caller = caller_of(Scripted({"evidence": "none"}))
    rows = asyncio.run(answer_question(SceneContext(_five()), question, caller, CategoryFieldConfig()))
    assert (rows.answers[0].status, rows.arms[0].predicted, rows.arms[0].iou) == ("answered", 0, 1.0)


class TestFiles:
    def _config(self, path: Path, **options: Any) -> ScoresFieldConfig:
        return ScoresFieldConfig(file=str(path), **options)

    def test_scores_by_question_id_or_text_from_the_threshold_on(self, tmp_path: Path) -> None:
        path = tmp_path / "five.npz"
        scores = np.array([[0.1, 0.5, 0.9, 0.2, 0.9], [0.9, 0.1, 0.1, 0.1, 0.1]], np.float32)
        valid = np.array([1, 1, 1, 1, 0], bool)
        np.savez(path, scores=scores, names=np.array(["q1", "another"]), valid=valid)
        config = self._config(tmp_path / "{scene}.npz")
        assert _ask(config, _five()).regions[0].gaussians == (1, 2)
        np.savez(path, scores=scores, names=np.array(["nobody", SENTENCE]), valid=valid)
        assert _ask(config, _five()).regions[0].gaussians == (0,)
        np.savez(path, scores=scores, names=np.array(["a", "b"]), valid=valid)
        with pytest.raises(InputError, match="the id or text of question 'q1', found 2 others"):
            _ask(config, _five())

    def test_a_file_a_question_needs_no_names(self, tmp_path: Path) -> None:
        np.savez(tmp_path / "q1.npz", scores=np.array([0, 0, 0, 1, 0], np.float32))
        assert _ask(self._config(tmp_path / "{question_id}.npz"), _five()).regions[0].gaussians == (3,)

    def test_features_are_searched_by_the_sentence(self, tmp_path: Path) -> None:
        np.savez(tmp_path / "f.npz", features=FEATURES[::-1], valid=np.array([1, 1, 1, 0, 1], bool))
        rows = _ask(self._config(tmp_path / "f.npz", by="cosine"), _five())
        assert rows.regions[0].gaussians == (4,)

    @pytest.mark.parametrize(
        ("arrays", "message"),
        [
            ({"scores": np.zeros(4)}, "expected 5 rows, one a Gaussian of five as loaded, found 4"),
            ({"scores": np.zeros((2, 5))}, "names: expected 2 texts, one a row of scores, found none"),
            ({"features": np.zeros(5)}, "expected an NPZ file with"),
            ({"other": np.zeros(5)}, "expected an NPZ file with .* found neither"),
            ({"scores": np.zeros(5), "features": np.zeros((5, 2))}, "expected an NPZ file with .* features, scores"),
            ({"scores": np.zeros(5), "valid": np.zeros(5)}, "valid: expected 5 booleans, found float64"),
            ({"scores": np.array([1, 2, np.nan, 0, 0])}, "scores: expected finite numbers where valid"),
            ({"scores": np.array([1, "a", {}], object)}, "expected an NPZ file with"),
        ],
    )
    def test_a_wrong_file_is_refused_and_says_how(self, tmp_path: Path, arrays: Any, message: str) -> None:
        np.savez(tmp_path / "f.npz", **arrays)
        with pytest.raises(InputError, match=message):
            read_field(str(tmp_path / "f.npz"), _five())

    def test_what_is_no_npz_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "f.npz").write_bytes(b"nothing of the kind")
        with pytest.raises(InputError, match="expected an NPZ file with"):
            read_field(str(tmp_path / "f.npz"), _five())
