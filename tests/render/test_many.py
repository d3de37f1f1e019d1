"""Many views: the bits of `render`, in order, streamed, with a bounded number under way."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from pipeline.geometry import Camera
from pipeline.render import EXACT, OUTPUTS, RenderQuality, many, prepare, render, render_many
from schemas.errors import InputError
from tests.render.scenes import assert_same_bits, camera, random_scene


def _views(number: int) -> list[Camera]:
    """Views of different sizes from a circle around the scene."""
    angles = np.linspace(0, 2 * np.pi, number, endpoint=False)
    return [camera(40 + k, 30, eye=(4 * np.cos(a), 4 * np.sin(a), 1.0)) for k, a in enumerate(angles)]


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("outputs", [OUTPUTS, ("dominant",)])
def test_many_views_have_the_bits_of_single_ones_in_order(threads: int, outputs: tuple[str, ...]) -> None:
    scene, views = random_scene(1, 400), _views(9)
    options = {"background": (0.1, 0.2, 0.3), "near": 0.5, "sh_degree": 0, "antialias": True}
    found = list(render_many(scene, views, outputs, threads=threads, **options))
    assert len(found) == len(views)
    for one, view in zip(found, views, strict=True):
        assert_same_bits(one, render(scene, view, outputs, **options))


def test_quality_reaches_every_view() -> None:
    prepared, views, half = prepare(random_scene(2, 200)), _views(3), RenderQuality(scale=0.5)
    for one, view in zip(render_many(prepared, views, quality=half), views, strict=True):
        assert_same_bits(one, render(prepared, view, quality=half))
        assert np.abs(one.color - render(prepared, view, quality=EXACT).color).max() > 0.01


def test_no_view_gives_nothing() -> None:
    assert list(render_many(random_scene(1, 5), [])) == []


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_cameras_are_taken_only_a_little_ahead_of_the_renderings(threads: int) -> None:
    taken = itertools.count(1)
    seen = 0

    def endless() -> Iterator[Camera]:
        nonlocal seen
        while True:
            seen = next(taken)
            yield camera(16, 16)

    frames = render_many(random_scene(3, 20), endless(), ("dominant",), threads=threads)
    assert seen == 0
    for number in range(1, 6):
        next(frames)
        assert seen <= number + many.LOOK_AHEAD * threads
    if threads > 1:
        frames.close()


def test_views_are_rendered_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two renders meet at a barrier that one alone would never pass."""
    meeting = threading.Barrier(2, timeout=20)

    def draw(prepared, view: Camera, **options: object):
        meeting.wait()
        return render(prepared, view, **options)

    monkeypatch.setattr(many, "render", draw)
    assert len(list(render_many(random_scene(4, 20), _views(4), threads=2))) == 4


def test_an_error_of_one_view_is_raised_in_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    views = _views(6)

    def draw(prepared, view: Camera, **options: object):
        if view is views[3]:
            raise RuntimeError("view 3")
        return render(prepared, view, **options)

    monkeypatch.setattr(many, "render", draw)
    frames = render_many(random_scene(5, 20), views, threads=2)
    for _ in range(3):
        next(frames)
    with pytest.raises(RuntimeError, match="view 3"):
        next(frames)


def test_closing_leaves_no_thread_behind() -> None:
    frames = render_many(random_scene(6, 20), _views(8), threads=3)
    next(frames)
    frames.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("view")]


@pytest.mark.parametrize(
    "arguments",
    [{"outputs": ("colour",)}, {"threads": 0}, {"near": -1.0}, {"sh_degree": 9}],
    ids=lambda a: next(iter(a)),
)
def test_bad_argument_is_an_input_error_at_the_call(arguments: dict) -> None:
    with pytest.raises(InputError, match=next(iter(arguments))):
        render_many(random_scene(1, 5), _views(1), **arguments)
