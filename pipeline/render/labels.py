"""Labels of Gaussians seen through the weights of all that contribute, not only through the dominant one."""

from __future__ import annotations

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

BAND_BYTES = 1 << 26
"""Sums held at a time where only the heaviest label of each pixel is wanted (one row of tiles at least)."""


@dataclass(frozen=True, slots=True)
class LabelImage:
    """The label that weighs most in each pixel."""

    labels: Int32[np.ndarray, "H W"]
    """-1 where no labelled Gaussian contributes; the lower of two that weigh the same."""
    weights: Float32[np.ndarray, "H W"]
    """Summed weight of that label, 0 to 1."""


def label_weights(
    gaussians: Gaussians | PreparedGaussians,
    camera: Camera,
    labels: Int32[np.ndarray, "M"],
    count: int,
    *,
    near: float = DEFAULT_NEAR_M,
    antialias: bool = False,
    threads: int = 1,
) -> Float32[np.ndarray, "H W L"]:
    """Return the weight of each label in each pixel: the sum of T * alpha over its Gaussians, 0 to 1.

    The sum over labels is alpha where every Gaussian has a label. Gaussians without one hide what is behind them.

    Args:
        gaussians: The scene. Prepare it once (`prepare`) when more than one view is rendered.
        camera: Lens, pose and image size.
        labels: Label of each Gaussian, 0 to count - 1; -1 for none.
        count: Number of labels L, 1 or more. The result takes 4 H W L bytes: see `label_image` for less.
        near: Gaussians at z <= near are left out, metres, 0 or more.
        antialias: Dim Gaussians by what the low-pass widened them.
        threads: Threads inside this frame; the bits do not depend on it.

    Raises:
        InputError: An argument is not as described.
    """
    whole = np.empty((camera.height, camera.width, count if count > 0 else 0), np.float32)
    _sum_labels(gaussians, camera, labels, count, near, antialias, threads, whole, None)
    return whole


def label_image(
    gaussians: Gaussians | PreparedGaussians,
    camera: Camera,
    labels: Int32[np.ndarray, "M"],
    count: int,
    *,
    near: float = DEFAULT_NEAR_M,
    antialias: bool = False,
    threads: int = 1,
) -> LabelImage:
    """Return the label with the largest summed weight in each pixel; arguments are those of `label_weights`.

    Sums are held for a band of rows at a time: about 64 MB, or one row of tiles where that is more.

    Raises:
        InputError: An argument is not as described.
    """
    shape = (camera.height, camera.width)
    image = LabelImage(np.empty(shape, np.int32), np.empty(shape, np.float32))
    _sum_labels(gaussians, camera, labels, count, near, antialias, threads, None, image)
    return image


def label_weights_reference(
    gaussians: Gaussians,
    camera: Camera,
    labels: Int32[np.ndarray, "M"],
    count: int,
    *,
    near: float = DEFAULT_NEAR_M,
    antialias: bool = False,
    threads: int = 1,
) -> Float32[np.ndarray, "H W L"]:
    """Return what `label_weights` should, in NumPy float64; `threads` is accepted and ignored.

    Raises:
        InputError: An argument is not as described.
    """
    _check(labels, count, len(gaussians))
    check_near(near)
    projection = project_float64(gaussians, camera, near, antialias)
    sums = np.zeros((camera.height, camera.width, count))
    for k, weight, _ in layers(projection, camera):
        label = labels[projection.ids[k]]
        if label >= 0:
            sums[..., label] += weight
    return sums.astype(np.float32)


def heaviest_label(sums: Float32[np.ndarray, "H W L"]) -> LabelImage:
    """Return the label with the largest sum in each pixel, the lower one of equals; -1 where all are 0."""
    best = sums.argmax(axis=-1)
    weights = np.take_along_axis(sums, best[..., None], axis=-1)[..., 0]
    return LabelImage(np.where(weights > 0, best, -1).astype(np.int32), weights)


def _sum_labels(
    gaussians: Gaussians | PreparedGaussians,
    camera: Camera,
    labels: Int32[np.ndarray, "M"],
    count: int,
    near: float,
    antialias: bool,
    threads: int,
    whole: Float32[np.ndarray, "H W L"] | None,
    image: LabelImage | None,
) -> None:
    """Fill `whole` with the sums, or `image` with the heaviest label of bands that come and go."""
    from pipeline.render.label_kernels import STATE, add_labels
    from pipeline.render.passes import Clock, Step, sorted_records, steps
    from pipeline.render.tile_kernels import BLOCKS
    from pipeline.render.workspace import WORKSPACE

    _check(labels, count, len(gaussians))
    check_near(near)
    check_threads(threads)
    prepared = gaussians if isinstance(gaussians, PreparedGaussians) else prepare(gaussians)
    clock, limits = Clock(None, threads), EXACT.limits()
    records = sorted_records(
        prepared, camera, Window.of(camera), near=near, antialias=antialias, quality=EXACT, threads=threads, clock=clock
    )
    band_tiles = None if image is None else BAND_BYTES // (256 * 4 * count)
    for step in steps(records, Window.of(camera), threads, clock, band_tiles=band_tiles):
        band = step.band
        top, bottom = band.window.top, band.window.bottom
        states = WORKSPACE.array("states", len(band.live) * BLOCKS * STATE, np.float32)
        if whole is not None:
            sums = whole[top:bottom].reshape(-1)
        else:
            sums = WORKSPACE.array("label sums", (bottom - top) * camera.width * count, np.float32)

        def work(
            start: int, stop: int, step: Step = step, states: np.ndarray = states, sums: np.ndarray = sums
        ) -> None:
            add_labels(*step.arguments(start, stop, records), limits, states, labels, count, sums)

        step.paint(work, threads)
        if image is not None and not band.live.any():
            part = heaviest_label(sums.reshape(bottom - top, camera.width, count))
            image.labels[top:bottom], image.weights[top:bottom] = part.labels, part.weights


def _check(labels: Int32[np.ndarray, "M"], count: int, gaussians: int) -> None:
    if count < 1:
        raise InputError("label_weights", field="count", expected="1 or more", found=count)
    if labels.shape != (gaussians,):
        raise InputError("label_weights", field="labels", expected=f"shape ({gaussians},)", found=labels.shape)
    if len(labels) and not -1 <= labels.min() <= labels.max() < count:
        found = f"{labels.min()} to {labels.max()}"
        raise InputError("label_weights", field="labels", expected=f"-1 to {count - 1}", found=found)
