"""Votes: sums against dictionaries, whatever the order; winners against a search; the memory bound holds and tells."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.construct.semantics.register_votes import Votes, VoteSums, frame_votes
from pipeline.render import prepare, top_contributors_reference
from tests.query.tiny import camera_at, gaussians_at

PIXEL_SUMS = 1e-4
"""The kernel renders in float32, the reference in float64; sums run over a few dozen pixels."""

PAIRS = st.dictionaries(
    st.tuples(st.integers(0, 5), st.integers(-1, 3)), st.floats(0.125, 8, width=16), min_size=0, max_size=12
)


def votes(pairs: dict[tuple[int, int], float]) -> Votes:
    keys = np.array([(g << 32) | (label + 1) for g, label in sorted(pairs)], np.int64)
    return Votes(keys, np.array([pairs[pair] for pair in sorted(pairs)], float))


def as_pairs(found: Votes) -> dict[tuple[int, int], float]:
    assert (np.diff(found.keys) > 0).all()
    return dict(
        zip(zip(found.gaussians.tolist(), found.labels.tolist(), strict=True), found.sums.tolist(), strict=True)
    )


@settings(max_examples=60, deadline=None)
@given(st.lists(PAIRS, max_size=9))
def test_sums_are_those_of_a_dictionary(frames: list[dict[tuple[int, int], float]]) -> None:
    sums, expected = VoteSums(1000), defaultdict(float)
    for frame in frames:
        sums.add(votes(frame))
        for pair, weight in frame.items():
            expected[pair] += weight
    assert as_pairs(sums.total()) == expected  # eighths add exactly
    assert sums.forgotten == 0.0


@settings(max_examples=60, deadline=None)
@given(PAIRS, st.sampled_from([0.0, 0.5, 1.0]))
def test_winners_are_those_of_a_search(pairs: dict[tuple[int, int], float], silence: float) -> None:
    winner, share, total = votes(pairs).winners(7, silence)
    for g in range(7):
        own = {label: w * (silence if label == -1 else 1.0) for (h, label), w in pairs.items() if h == g}
        best = max(own.values(), default=0.0)
        expected = min((label for label, w in own.items() if w == best), default=-1) if best else -1
        assert winner[g] == expected
        assert total[g] == sum(own.values())
        assert share[g] == pytest.approx(best / total[g] if expected >= 0 else 0.0)


def test_bound_keeps_each_gaussians_heaviest_labels_and_says_what_is_lost() -> None:
    sums = VoteSums(6)
    sums.add(votes({(g, label): 10.0 if label == 0 else 0.5 for g in range(4) for label in range(3)}))
    kept = as_pairs(sums.total())
    assert kept == {(g, 0): 10.0 for g in range(4)}
    assert sums.forgotten == pytest.approx(4 / 44)
    assert sums.most_pairs == 12


def test_matrix_holds_the_sums_of_its_rows() -> None:
    dense = votes({(1, 0): 1.0, (1, 2): 2.0, (3, 1): 4.0, (4, 0): 8.0}).matrix(1, 4, 3).toarray()
    assert dense.tolist() == [[1, 0, 2], [0, 0, 0], [0, 4, 0]]


@pytest.mark.parametrize("weighed", [False, True])
def test_a_frame_gives_each_pixels_label_to_its_contributors(weighed: bool) -> None:
    rng = np.random.default_rng(4)
    gaussians = gaussians_at(rng.uniform((-1, 2, 0), (1, 3, 1.5), (60, 3)), 0.15, 0.5)
    camera = camera_at((0, 0, 0.7), (0, 3, 0.7))
    labels = rng.integers(-1, 4, (36, 48)).astype(np.int32)
    confidence = rng.random((36, 48)).astype(np.float32) if weighed else None
    found = as_pairs(frame_votes(prepare(gaussians), camera, labels, confidence, 5, 20))
    top = top_contributors_reference(gaussians, camera, 5, first=20)
    expected: dict[tuple[int, int], float] = defaultdict(float)
    for row, column, k in np.ndindex(top.ids.shape):
        if (g := int(top.ids[row, column, k])) >= 0:
            label = int(labels[row, column])
            factor = 1.0 if confidence is None or label < 0 else float(confidence[row, column])
            expected[g, label] += factor * float(top.weights[row, column, k])
    assert found.keys() == expected.keys()
    assert max(abs(found[pair] - expected[pair]) for pair in expected) < PIXEL_SUMS
    assert len(expected) > 100


def test_more_pairs_than_the_first_room_are_all_kept() -> None:
    from pipeline.construct.semantics.register_kernels import FIRST_ROOM, tally

    count = FIRST_ROOM + 7
    ids = np.arange(count, dtype=np.int32)[:, None]
    weights = np.full((count, 1), 0.5, np.float32)
    keys, sums = tally(ids, weights, np.zeros(count, np.int32), np.empty(0, np.float32), count)
    assert (keys == (np.arange(count) << 32) + 1).all()
    assert (sums == 0.5).all()
