"""Registration: labels land on the Gaussians that painted them, and on no others."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from pipeline.construct.semantics.labels_2d import FrameFeatures, FrameLabels
from pipeline.construct.semantics.register import RegistrationConfig, register_features, register_labels
from pipeline.render import label_image, prepare, top_contributors_reference
from pipeline.scene import Scene
from pipeline.scene.captures import Frame
from schemas.errors import InputError
from tests.query.tiny import tiny_scene

FLOAT16 = 2e-3
"""Two roundings to 16 bits of numbers up to 1."""


class Truth:
    """Label images painted from a scene's own semantics."""

    description, silence = "truth", 0.0

    def __init__(self, scene: Scene, instances: bool = False, blind: frozenset[str] = frozenset()) -> None:
        self.scene, self.instances, self.blind = scene, instances, blind
        self.vocabulary = scene.semantics.vocabulary
        self.prepared = prepare(scene.gaussians)

    def labels(self, frame: Frame) -> FrameLabels:
        instance = self.scene.semantics.instance
        assert instance is not None
        assert self.scene.semantics.category is not None
        ids = label_image(self.prepared, frame.camera, instance, 5).labels
        categories = np.full(6, -1, np.int32)
        categories[instance] = self.scene.semantics.category
        categories[-1] = -1
        category = categories[ids]
        if frame.name in self.blind:
            category = np.full_like(category, -1)
        return FrameLabels(category, None, np.where(category < 0, -1, ids).astype(np.int32) if self.instances else None)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene()


@pytest.fixture(scope="module")
def frames(scene: Scene) -> list[Frame]:
    return [Frame(view.name, view.camera.resized(96, 72)) for view in scene.views]


def test_visible_gaussians_get_their_category_and_hidden_ones_none(scene: Scene, frames: list[Frame]) -> None:
    found = register_labels(scene.gaussians, frames, Truth(scene, instances=True))
    truth, instance = scene.semantics.category, scene.semantics.instance
    assert truth is not None
    assert instance is not None
    assert found.instance is not None
    labelled = found.category >= 0
    # The boxes are filled: edges shine through, and what lies within is seen by little weight.
    assert (found.category[labelled] == truth[labelled]).mean() > 0.95
    assert labelled[instance < 3].mean() > 0.85
    # The wall is no sheet: a little shines through it. Nothing behind it weighs most in any pixel.
    heaviest = register_labels(scene.gaussians, frames, Truth(scene), RegistrationConfig(contributors=1))
    assert not (heaviest.category >= 0)[instance == 4].any()
    assert (found.instance[labelled] == instance[labelled]).mean() > 0.95
    # A category and an instance of one pair never contradict each other.
    own_category = {0: 0, 1: 0, 2: 1, 3: 2}
    assert all(own_category[i] == c for i, c in zip(found.instance[labelled], found.category[labelled], strict=True))
    assert found.report.frames == 6
    assert found.report.labelled == int(labelled.sum())
    assert found.report.forgotten == 0.0
    assert (found.confidence[labelled] > 0).all()


def test_threads_change_no_bit(scene: Scene, frames: list[Frame]) -> None:
    one, four = (register_labels(scene.gaussians, frames, Truth(scene), threads=threads) for threads in (1, 4))
    assert one.category.tobytes() == four.category.tobytes()
    assert one.confidence.tobytes() == four.confidence.tobytes()
    assert one.instance is None
    assert one.report == four.report


def test_frames_that_show_nothing_named_vote_as_silence_weighs(scene: Scene, frames: list[Frame]) -> None:
    blind = Truth(scene, blind=frozenset(frame.name for frame in frames[1:]))
    ignoring = register_labels(scene.gaussians, frames, blind)
    counting = register_labels(scene.gaussians, frames, blind, RegistrationConfig(silence=1.0))
    assert counting.report.labelled < ignoring.report.labelled / 2
    kept = (counting.category >= 0) & (ignoring.category >= 0)
    assert kept.sum() > 20
    assert (counting.category[kept] == ignoring.category[kept]).all()


def test_least_confidence_and_least_weight_take_labels_away(scene: Scene, frames: list[Frame]) -> None:
    found = register_labels(scene.gaussians, frames, Truth(scene))
    strict = register_labels(scene.gaussians, frames, Truth(scene), RegistrationConfig(least_confidence=0.99))
    assert ((strict.category >= 0) == ((found.category >= 0) & (found.confidence >= 0.99))).all()
    heavy = register_labels(scene.gaussians, frames, Truth(scene), RegistrationConfig(least_weight=3.0))
    assert 0 < heavy.report.labelled < found.report.labelled


def test_memory_bound_forgets_and_says_so(scene: Scene, frames: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    whole = register_labels(scene.gaussians, frames, Truth(scene))
    room = int(0.9 * whole.report.pairs)
    monkeypatch.setattr("pipeline.construct.semantics.register.PAIR_BYTES", (16 << 20) // room)
    found = register_labels(scene.gaussians, frames, Truth(scene), RegistrationConfig(memory_mb=16))
    assert found.report.pairs < whole.report.pairs
    assert 0 < found.report.forgotten < 0.2
    assert (found.category == whole.category)[found.category >= 0].mean() > 0.95


def test_large_label_images_are_thinned(scene: Scene, frames: list[Frame]) -> None:
    sizes: list[tuple[int, int]] = []

    class Large(Truth):
        def labels(self, frame: Frame) -> FrameLabels:
            sizes.append((frame.camera.width, frame.camera.height))
            return super().labels(dataclasses.replace(frame, camera=frame.camera.resized(192, 144)))

    full = register_labels(scene.gaussians, frames, Large(scene))
    thin = register_labels(scene.gaussians, frames, Large(scene), RegistrationConfig(longest_side=96))
    both = (full.category >= 0) & (thin.category >= 0)
    assert (full.category[both] == thin.category[both]).mean() > 0.97
    assert thin.report.labelled > 0.8 * full.report.labelled
    assert sizes == [(96, 72)] * 12


class Masks:
    """Masks with random features of random norm; one mask is all zero, which counts as none."""

    dimension, description = 4, "masks"

    def features(self, frame: Frame) -> FrameFeatures:
        rng = np.random.default_rng(int(frame.name[-1]) if frame.name[-1].isdigit() else 0)
        rows = rng.normal(size=(6, 4)) * rng.uniform(0.5, 9, (6, 1))
        rows[2] = 0
        masks = rng.integers(-1, 6, (12, 16)).repeat(3, 0).repeat(3, 1)
        return FrameFeatures(masks.astype(np.int32), rows.astype(np.float32))


def test_features_are_the_normalised_weighted_mean(scene: Scene) -> None:
    frames = [Frame(view.name, view.camera) for view in scene.views[:2]]
    config = RegistrationConfig(contributors=4, first=30)
    found = register_features(scene.gaussians, frames, Masks(), config)
    sums, weight = np.zeros((len(scene.gaussians), 4)), np.zeros(len(scene.gaussians))
    for frame in frames:
        top = top_contributors_reference(scene.gaussians, frame.camera, 4, first=30)
        seen = Masks().features(frame)
        norms = np.linalg.norm(seen.features, axis=1, keepdims=True)
        unit = np.vstack([seen.features / np.where(norms > 0, norms, 1), np.zeros((1, 4))])
        for k in range(4):
            np.add.at(sums, top.ids[..., k], top.weights[..., k, None] * unit[seen.masks])
            np.add.at(weight, top.ids[..., k], top.weights[..., k] * unit[seen.masks].any(axis=-1))
    clear = (np.linalg.norm(sums, axis=1) > 0.05) & (weight > 0.01)
    expected = sums[clear] / np.linalg.norm(sums[clear], axis=1, keepdims=True)
    assert clear.sum() > 100
    np.testing.assert_allclose(found.embedding[clear].astype(float), expected, atol=FLOAT16)
    assert (found.valid == (found.embedding != 0).any(axis=1)).all()
    assert not found.valid[scene.semantics.instance == 4].any()
    assert found.embedding.dtype == np.float16
    assert found.report.labelled == int(found.valid.sum())


def test_feature_threads_change_no_bit(scene: Scene, frames: list[Frame]) -> None:
    frames = [dataclasses.replace(frame, camera=frame.camera.resized(48, 36)) for frame in frames]
    one, three = (register_features(scene.gaussians, frames, Masks(), threads=threads) for threads in (1, 3))
    assert one.embedding.tobytes() == three.embedding.tobytes()


def test_progress_counts_frames(scene: Scene, frames: list[Frame]) -> None:
    seen: list[int] = []
    register_labels(scene.gaussians, frames, Truth(scene), threads=2, progress=seen.append)
    assert seen == [1, 2, 3, 4, 5, 6]


def test_no_frame_is_refused(scene: Scene) -> None:
    with pytest.raises(InputError, match="registration: frames: expected at least one"):
        register_labels(scene.gaussians, [], Truth(scene))


def test_ids_beyond_the_vocabulary_are_refused(scene: Scene, frames: list[Frame]) -> None:
    source = Truth(scene)
    source.vocabulary = ("chair",)
    with pytest.raises(InputError, match=re.escape("labels: category: expected ids up to 0")):
        register_labels(scene.gaussians, frames, source)


def test_features_of_another_size_are_refused(scene: Scene, frames: list[Frame]) -> None:
    class Wrong(Masks):
        dimension = 5

    with pytest.raises(InputError, match="expected 5, as the source declares, found 4"):
        register_features(scene.gaussians, frames, Wrong())


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"category": np.full((3, 4), -2, np.int32)}, "expected ids from -1"),
        ({"confidence": np.full((3, 4), 1.5, np.float32)}, "expected 0 to 1"),
        ({"confidence": np.full((3, 4), np.nan, np.float32)}, "expected 0 to 1"),
    ],
)
def test_label_images_that_make_no_sense_are_refused(changed: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InputError, match=message):
        FrameLabels(**{"category": np.zeros((3, 4), np.int32), **changed})


@pytest.mark.parametrize(
    ("masks", "features"),
    [
        (np.full((2, 2), 3, np.int32), np.ones((3, 2), np.float32)),
        (np.zeros((2, 2), np.int32), np.full((1, 2), np.nan, np.float32)),
    ],
)
def test_masks_without_a_finite_feature_are_refused(masks: np.ndarray, features: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"expected"):
        FrameFeatures(masks, features)
