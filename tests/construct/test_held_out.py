from __future__ import annotations

from dataclasses import replace

import pytest

from pipeline.construct.held_out import split_held_out
from pipeline.scene.captures import Capture
from tests.construct.tiny_capture import frames, truth


@pytest.fixture(scope="module")
def capture() -> Capture:
    return Capture("tiny", tuple(frames(truth(), 20)))


def test_the_last_of_every_five_is_kept_from_fitting_and_measured(capture: Capture) -> None:
    fitted, held_out = split_held_out(capture, 5, 50)
    assert [frame.name for frame in held_out] == ["004", "009", "014", "019"]
    assert len(fitted) == 16
    assert not {frame.name for frame in held_out} & {frame.name for frame in fitted.frames}


def test_of_many_kept_frames_some_are_measured_and_none_is_fitted(capture: Capture) -> None:
    fitted, held_out = split_held_out(capture, 2, 3)
    assert [frame.name for frame in held_out] == ["001", "009", "019"]
    assert len(fitted) == 10


def test_frames_without_a_photograph_are_not_measured(capture: Capture) -> None:
    bare = replace(capture, frames=tuple(replace(frame, image=None) for frame in capture.frames))
    assert split_held_out(bare, 5, 50)[1] == ()


@pytest.mark.parametrize("every", [None, 21])
def test_nothing_is_kept_where_it_is_not_asked_for_or_too_much(capture: Capture, every: int | None) -> None:
    assert split_held_out(capture, every, 50) == (capture, ())
