"""Many views of one scene: one core per view, results in order while later views are still being rendered."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

from pipeline.geometry import Camera
from pipeline.render.api import (
    DEFAULT_NEAR_M,
    OUTPUTS,
    check_near,
    check_threads,
    checked_degree,
    checked_outputs,
    render,
)
from pipeline.render.prepare import PreparedGaussians, prepare
from pipeline.render.quality import EXACT, RenderQuality
from pipeline.render.rendering import Rendering
from pipeline.scene.gaussians import Gaussians

LOOK_AHEAD = 2
"""Views per thread that may be in work or waiting to be taken: bounds memory where the consumer is slow."""


def render_many(
    gaussians: Gaussians | PreparedGaussians,
    cameras: Iterable[Camera],
    outputs: Iterable[str] = OUTPUTS,
    *,
    threads: int = 2,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    near: float = DEFAULT_NEAR_M,
    sh_degree: int | None = None,
    antialias: bool = False,
    quality: RenderQuality = EXACT,
) -> Iterator[Rendering]:
    """Return an iterator over the renderings of `cameras`, in their order, each with the bits `render` gives.

    The scene is prepared once. Cameras are taken only as renderings are: no more than two per thread are under way or
    waiting, so that neither many cameras nor a slow consumer fills memory. An error of one view is raised in its turn.
    Closing the iterator drops the views not begun.

    Args:
        gaussians: The scene.
        cameras: The views; may be endless.
        outputs: As in `render`.
        threads: Views rendered side by side. With 1, each is rendered by the caller when it is asked for.
        background: As in `render`.
        near: As in `render`.
        sh_degree: As in `render`.
        antialias: As in `render`.
        quality: As in `render`.

    Raises:
        InputError: An argument is not as described; raised at the call.
    """
    prepared = gaussians if isinstance(gaussians, PreparedGaussians) else prepare(gaussians)
    wanted = checked_outputs(outputs)
    checked_degree(sh_degree, prepared.sh_degree)
    check_near(near)
    check_threads(threads)
    draw = partial(
        render,
        prepared,
        outputs=wanted,
        background=background,
        near=near,
        sh_degree=sh_degree,
        antialias=antialias,
        quality=quality,
    )
    return map(draw, cameras) if threads == 1 else _ahead(draw, cameras, threads)


def _ahead(draw: partial[Rendering], cameras: Iterable[Camera], threads: int) -> Iterator[Rendering]:
    waiting: deque[Future[Rendering]] = deque()
    # A pool of its own: its threads end, and give their scratch memory back, with the iterator.
    pool = ThreadPoolExecutor(threads, thread_name_prefix="view")
    try:
        for camera in cameras:
            waiting.append(pool.submit(draw, camera))
            if len(waiting) == LOOK_AHEAD * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
