"""The heaviest Gaussians of every pixel: what registration spreads a pixel's feature over."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32

from pipeline.geometry import Camera
from pipeline.render.api import DEFAULT_NEAR_M, check_near, check_threads
from pipeline.render.prepare import PreparedGaussians, prepare
from pipeline.render.quality import EXACT
from pipeline.render.reference import layers, project_float64
from pipeline.render.window import Window
from pipeline.scene.gaussians import Gaussians
from schemas.errors import InputError

MOST_COUNTED = 1 << 24
"""The kernel counts contributions in float32, which is exact up to here."""


@dataclass(frozen=True, slots=True)
class Contributors:
    """The k heaviest Gaussians of each pixel, heaviest first; equal weights nearest first."""

    ids: Int32[np.ndarray, "H W k"]
    """Index in the scene; -1 in places beyond the pixel's last contribution."""
    weights: Float32[np.ndarray, "H W k"]
    """T * alpha of each, 0 to 1; 0 where `ids` is -1."""


def top_contributors(
    gaussians: Gaussians | PreparedGaussians,
    camera: Camera,
    k: int,
    *,
    first: int | None = None,
    near: float = DEFAULT_NEAR_M,
    antialias: bool = False,
    threads: int = 1,
) -> Contributors:
    """Return the Gaussians that weigh most in each pixel; with k = 1 they are the dominant ones.

    The result takes 8 H W k bytes, and little more is used while it is made.

    Args:
        gaussians: The scene. Prepare it once (`prepare`) when more than one view is looked at.
        camera: Lens, pose and image size.
        k: Gaussians kept per pixel, 1 or more.
        first: Only the nearest so many contributions of a pixel are looked at (Dr. Splat takes 100); None for all.
        near: Gaussians at z <= near are left out, metres, 0 or more.
        antialias: Dim Gaussians by what the low-pass widened them.
        threads: Threads inside this frame.

    Raises:
        InputError: An argument is not as described.
    """
    from pipeline.render.contributor_kernels import STATE, collect
    from pipeline.render.passes import Clock, Step, sorted_records, steps
    from pipeline.render.tile_kernels import BLOCKS
    from pipeline.render.workspace import WORKSPACE

    _check(k, first)
    check_near(near)
    check_threads(threads)
    prepared = gaussians if isinstance(gaussians, PreparedGaussians) else prepare(gaussians)
    clock, limits = Clock(None, threads), EXACT.limits()
    whole = Window.of(camera)
    records = sorted_records(
        prepared, camera, whole, near=near, antialias=antialias, quality=EXACT, threads=threads, clock=clock
    )
    shape = (camera.height, camera.width, k)
    ids, weights = np.empty(math.prod(shape), np.int32), np.empty(math.prod(shape), np.float32)
    most = np.float32(np.inf if first is None else first)
    for step in steps(records, whole, threads, clock):
        states = WORKSPACE.array("states", len(step.band.live) * BLOCKS * STATE, np.float32)

        window = step.band.window
        rows = slice(window.top * window.width * k, window.bottom * window.width * k)

        def work(start: int, stop: int, step: Step = step, states: np.ndarray = states, rows: slice = rows) -> None:
            collect(*step.arguments(start, stop, records), limits, states, k, most, ids[rows], weights[rows])

        step.paint(work, threads)
    return Contributors(ids.reshape(shape), weights.reshape(shape))


def top_contributors_reference(
    gaussians: Gaussians,
    camera: Camera,
    k: int,
    *,
    first: int | None = None,
    near: float = DEFAULT_NEAR_M,
    antialias: bool = False,
    threads: int = 1,
) -> Contributors:
    """Return what `top_contributors` should, in NumPy float64, from every weight at once: for small scenes.

    Arguments are those of `top_contributors`; `threads` is accepted and ignored.

    Raises:
        InputError: An argument is not as described.
    """
    _check(k, first)
    check_near(near)
    projection = project_float64(gaussians, camera, near, antialias)
    everything = [np.zeros((k, camera.height, camera.width))]  # so that there are k of them
    everything += [weight[None] for _, weight, _ in layers(projection, camera)]
    depth_order = np.concatenate([*everything[1:], everything[0]])
    if first is not None:
        depth_order[np.cumsum(depth_order > 0, axis=0) > first] = 0.0
    heaviest = np.argsort(-depth_order, axis=0, kind="stable")[:k]
    weights = np.take_along_axis(depth_order, heaviest, axis=0)
    ids = np.concatenate([projection.ids, np.full(k, -1)])[heaviest]
    return Contributors(
        np.ascontiguousarray(np.moveaxis(np.where(weights > 0, ids, -1), 0, -1).astype(np.int32)),
        np.ascontiguousarray(np.moveaxis(weights, 0, -1).astype(np.float32)),
    )


def _check(k: int, first: int | None) -> None:
    if k < 1:
        raise InputError("top_contributors", field="k", expected="1 or more", found=k)
    if first is not None and not 1 <= first <= MOST_COUNTED:
        raise InputError("top_contributors", field="first", expected=f"1 to {MOST_COUNTED}, or None", found=first)
