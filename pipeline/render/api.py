"""What callers use: checks arguments, prepares where needed, and hands over to the phases or to the reference.

The kernels, and numba with them, are imported at the first frame, so that importing this package stays cheap.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Int32

from pipeline.geometry import Camera
from pipeline.render.prepare import PreparedGaussians, prepare
from pipeline.render.quality import EXACT, RenderQuality
from pipeline.render.reference import render_float64
from pipeline.render.rendering import Rendering
from pipeline.render.scaling import enlarged
from pipeline.render.window import Tiles
from pipeline.scene.gaussians import Gaussians
from schemas.errors import InputError

OUTPUTS = ("color", "depth", "alpha", "dominant")
"""What a frame can hold; `dominant` brings its weight along."""
DEFAULT_NEAR_M = 0.2
"""Near plane of the reference rasteriser."""


def render(
    gaussians: Gaussians | PreparedGaussians,
    camera: Camera,
    outputs: Iterable[str] = OUTPUTS,
    *,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    near: float = DEFAULT_NEAR_M,
    sh_degree: int | None = None,
    antialias: bool = False,
    threads: int = 1,
    quality: RenderQuality = EXACT,
    window: Tiles | None = None,
) -> Rendering:
    """Return images of the Gaussians as the camera sees them; the same bits at any thread count.

    Only what is asked for is computed: `dominant` alone needs no colour and stops earliest.

    Args:
        gaussians: The scene. Prepare it once (`prepare`) when more than one view is rendered.
        camera: Lens, pose and image size.
        outputs: Any of color, depth, alpha, dominant.
        background: Linear RGB seen where transmittance is left.
        near: Gaussians at z <= near are left out, metres, 0 or more.
        sh_degree: Highest spherical-harmonics degree used; None for what the scene holds.
        antialias: Dim Gaussians by what the low-pass widened them.
        threads: Threads inside this frame. One core per view (`render_many`) beats several in one view.
        quality: What may be given up for speed; nothing by default.
        window: The part of the image that is rendered: first column, first row, last column and last row of 16 x 16
            tiles, the last ones not included. The images hold its pixels only, with the bits they have in the whole
            image, and the cost falls with its size. None for the whole image; needs scale 1.

    Raises:
        InputError: An argument is not as described.
    """
    from pipeline.render.passes import render_frame

    prepared = gaussians if isinstance(gaussians, PreparedGaussians) else prepare(gaussians)
    wanted = checked_outputs(outputs)
    degree = checked_degree(sh_degree, prepared.sh_degree)
    check_near(near)
    check_threads(threads)
    check_window(window, quality)
    frame = render_frame(
        prepared,
        quality.camera(camera),
        wanted,
        background=background,
        near=near,
        sh_degree=min(degree, quality.sh_degree),
        antialias=antialias,
        threads=threads,
        quality=quality,
        window=window,
    )
    return frame if window is not None else enlarged(frame, camera.width, camera.height)


def render_reference(
    gaussians: Gaussians,
    camera: Camera,
    outputs: Iterable[str] = OUTPUTS,
    *,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    near: float = DEFAULT_NEAR_M,
    sh_degree: int | None = None,
    antialias: bool = False,
    threads: int = 1,
    quality: RenderQuality = EXACT,
) -> Rendering:
    """Return what `render` should, in NumPy float64, Gaussian by Gaussian: slow, obvious, for small scenes.

    Arguments are those of `render`; `threads` is accepted and ignored.

    Raises:
        InputError: An argument is not as described.
    """
    wanted = checked_outputs(outputs)
    degree = checked_degree(sh_degree, gaussians.sh_degree)
    check_near(near)
    frame = render_float64(
        gaussians,
        quality.camera(camera),
        wanted,
        background=background,
        near=near,
        sh_degree=min(degree, quality.sh_degree),
        antialias=antialias,
        quality=quality,
    )
    return enlarged(frame, camera.width, camera.height)


def visible_ids(
    gaussians: Gaussians | PreparedGaussians,
    camera: Camera,
    *,
    near: float = DEFAULT_NEAR_M,
    threads: int = 1,
    quality: RenderQuality = EXACT,
    window: Tiles | None = None,
) -> Int32[np.ndarray, "n"]:
    """Return the Gaussians that dominate at least one pixel: sorted, unique indices (paper, G_vis of one view).

    Arguments are those of `render`; with a `window`, only its pixels are looked at.
    """
    dominant = render(
        gaussians, camera, ("dominant",), near=near, threads=threads, quality=quality, window=window
    ).dominant
    assert dominant is not None
    seen = np.zeros(len(gaussians) + 1, bool)  # marking is several times faster than sorting the pixels
    seen[dominant] = True  # -1 marks the last place, which is cut off
    return np.flatnonzero(seen[:-1]).astype(np.int32)


def checked_outputs(outputs: Iterable[str]) -> frozenset[str]:
    """Return the outputs as a set; InputError where one is unknown or none is given."""
    wanted = frozenset(outputs)
    if not wanted or isinstance(outputs, str) or not wanted <= set(OUTPUTS):
        raise InputError("render", field="outputs", expected=f"one or more of {OUTPUTS}", found=outputs)
    return wanted


def checked_degree(sh_degree: int | None, stored: int) -> int:
    """Return the degree to use; InputError where more is asked for than is stored."""
    if sh_degree is None:
        return stored
    if not 0 <= sh_degree <= stored:
        raise InputError("render", field="sh_degree", expected=f"0 to {stored}, as stored", found=sh_degree)
    return sh_degree


def check_near(near: float) -> None:
    """Raise InputError unless `near` is a distance of 0 m or more."""
    if not (np.isfinite(near) and near >= 0):
        raise InputError("render", field="near", expected="a distance of 0 m or more", found=near)


def check_threads(threads: int) -> None:
    """Raise InputError unless there is at least one thread."""
    if threads < 1:
        raise InputError("render", field="threads", expected="1 or more", found=threads)


def check_window(window: Tiles | None, quality: RenderQuality) -> None:
    """Raise InputError where a part of the image is asked for at another scale than 1; tiles are checked later."""
    if window is not None and quality.scale != 1.0:
        raise InputError("render", field="window", expected="a quality of scale 1", found=quality.scale)
