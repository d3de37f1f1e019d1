"""From what a model says to detections: names of the vocabulary, sure enough, with masks where there are any."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from jaxtyping import UInt8

from pipeline.construct.semantics.labels_2d.detector import Detector, DetectorConfig, Found
from pipeline.construct.semantics.labels_2d.torch_detector import rows_of

BOX = (1.0, 2.0, 3.0, 4.0)


class Seer(Detector):
    """Sees what it was told."""

    seen: tuple[Found, ...] = ()

    def find(self, image: UInt8[np.ndarray, "H W 3"]) -> Iterable[Found]:
        return self.seen


def test_weak_unknown_and_unwanted_things_are_left_out() -> None:
    seer = Seer(DetectorConfig(least_confidence=0.5), ("person", "chair", "N/A", "chair"), "a seer")
    assert seer.vocabulary == ("chair", "N/A")
    assert seer.description == "a seer, confidence >= 0.5"
    seer.seen = tuple(Found(*one, BOX) for one in (("person", 1.0), ("chair", 0.4), ("lamp", 1.0), ("chair", 1.5)))
    (one,) = seer.detect(np.zeros((4, 4, 3), np.uint8))
    assert (one.category, one.confidence, one.box, one.mask) == (0, 1.0, BOX, None)


@pytest.mark.parametrize("masks", [False, True])
def test_tensors_become_rows(masks: bool) -> None:
    torch = pytest.importorskip("torch")
    found = {"labels": torch.tensor([62, 12]), "scores": torch.tensor([0.5, 0.25]), "boxes": torch.tensor([BOX, BOX])}
    if masks:
        found["masks"] = torch.tensor([[[[0.9, 0.1]]], [[[0.0, 0.6]]]])
    chair, gap = rows_of(found, {62: "chair"})
    assert (chair.name, chair.confidence, chair.box, gap.name) == ("chair", 0.5, BOX, "")
    expected = [[[True, False]], [[False, True]]] if masks else [None, None]
    assert [None if one.mask is None else one.mask.tolist() for one in (chair, gap)] == expected
