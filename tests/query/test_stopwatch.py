from __future__ import annotations

import pytest

from pipeline.query.stopwatch import Stopwatch


def test_stages_are_kept_in_the_order_in_which_they_end_with_their_counts() -> None:
    watch = Stopwatch()
    with watch.stage("outer", 2), watch.stage("inner", whole_scene=True):
        pass
    assert [(t.stage, t.count, t.whole_scene) for t in watch.times()] == [("inner", 0, True), ("outer", 2, False)]
    inner, outer = watch.times()
    assert 0 <= inner.seconds <= outer.seconds


def test_a_stage_timed_again_adds_up_in_its_first_place() -> None:
    watch = Stopwatch()
    for name, count in (("answer", 2), ("verify", 1), ("answer", 3)):
        with watch.stage(name, count):
            pass
    assert [(t.stage, t.count) for t in watch.times()] == [("answer", 5), ("verify", 1)]


def test_a_stage_that_raises_is_timed() -> None:
    watch = Stopwatch()
    with pytest.raises(ValueError, match="no"), watch.stage("failing"):
        raise ValueError("no")
    assert [time.stage for time in watch.times()] == ["failing"]
