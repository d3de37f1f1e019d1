"""3D-Mem's rule against a brute-force statement of it, and its laws."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.baselines.snapshot_rule import Snapshot, choose_snapshots, split_in_two


def _stated(places: np.ndarray, held: np.ndarray, confidence: np.ndarray) -> dict[int, set[int]]:
    """The rule in plain words: sets and loops, one object and frame at a time."""
    objects, frames = range(held.shape[0]), range(held.shape[1])
    waiting = [[o for o in objects if any(held[o, f] for f in frames)]]
    chosen: dict[int, set[int]] = {}
    while any(waiting):
        sizes = [len(group) for group in waiting]
        group = waiting.pop(sizes.index(max(sizes)))
        best = None
        for f in frames:
            if all(held[o, f] for o in group):
                everything = sum(bool(held[o, f]) for o in objects)
                rank = (f in chosen, everything, confidence[group, f].sum())
                if best is None or rank > best[0]:
                    best = (rank, f)
        if best is None:
            waiting += [half.tolist() for half in split_in_two(places, np.array(group))]
        else:
            chosen.setdefault(best[1], set()).update(group)
    return chosen


@st.composite
def _scenes(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    objects, frames = draw(st.integers(1, 9)), draw(st.integers(1, 6))
    places = np.round(rng.normal(0, 2, (objects, 2)), draw(st.sampled_from([0, 3])))
    held = rng.random((objects, frames)) < draw(st.floats(0, 1))
    return places, held, np.round(rng.random((objects, frames)), draw(st.sampled_from([1, 6])))


@settings(deadline=None, max_examples=60)
@given(_scenes())
def test_choose_snapshots_is_the_rule_as_stated(scene: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    places, held, confidence = scene
    found = choose_snapshots(places, held, confidence)
    assert {one.frame: set(one.objects) for one in found} == _stated(places, held, confidence)
    given_out = [number for one in found for number in one.objects]
    assert sorted(given_out) == np.flatnonzero(held.any(axis=1)).tolist()
    assert all(held[list(one.objects), one.frame].all() for one in found)


def test_one_frame_that_holds_all_objects_is_the_only_snapshot() -> None:
    held = np.array([[True, True], [True, False], [True, True]])
    found = choose_snapshots(np.zeros((3, 2)), held, np.ones((3, 2)))
    assert found == [Snapshot(0, (0, 1, 2))]


def test_a_frame_of_more_objects_goes_before_a_surer_one() -> None:
    places = np.array([[0.0, 0.0], [0.5, 0.0], [9.0, 0.0], [9.1, 0.0]])
    held = np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1], [0, 1, 0]], bool)
    confidence = np.array([[0.9, 0.2, 0], [0.9, 0.2, 0], [0, 0, 0.8], [0, 0.1, 0]])
    assert choose_snapshots(places, held, confidence) == [Snapshot(1, (0, 1, 3)), Snapshot(2, (2,))]
    assert choose_snapshots(places[:3], held[:3], confidence[:3]) == [Snapshot(0, (0, 1)), Snapshot(2, (2,))]


def test_objects_at_one_place_are_split_all_the_same() -> None:
    held = np.eye(4, dtype=bool)
    found = choose_snapshots(np.zeros((4, 2)), held, np.ones((4, 4)))
    assert [one.objects for one in found] == [(0,), (1,), (2,), (3,)]


def test_no_object_or_no_frame_gives_no_snapshot() -> None:
    assert choose_snapshots(np.empty((0, 2)), np.empty((0, 3), bool), np.empty((0, 3))) == []
    assert choose_snapshots(np.zeros((2, 2)), np.zeros((2, 3), bool), np.zeros((2, 3))) == []


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.integers(2, 12))
def test_split_in_two_settles_with_every_object_nearer_its_own_mean(seed: int, count: int) -> None:
    places = np.random.default_rng(seed).normal(size=(count, 2))
    halves = split_in_two(places, np.arange(count))
    assert sorted(np.concatenate(halves).tolist()) == list(range(count))
    means = [places[half].mean(axis=0) for half in halves]
    for own, other, half in ((0, 1, halves[0]), (1, 0, halves[1])):
        near = np.linalg.norm(places[half] - means[own], axis=1)
        assert (near <= np.linalg.norm(places[half] - means[other], axis=1) + 1e-12).all()
