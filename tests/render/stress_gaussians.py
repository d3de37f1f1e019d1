"""Stress cases of single Gaussians: shapes, rotations, opacities, colours and places no trained scene should hold."""

from __future__ import annotations

import numpy as np

from pipeline.render import render
from pipeline.scene.gaussians import Gaussians
from tests.render.scenes import front_camera, gaussians
from tests.render.stress_cases import Case, Outcome, image_case, mean_alpha
from tests.render.stress_decimal import exact_alpha

RIM = 1e-5
"""Alphas this near to 1/255 may be counted or not."""


def view():
    """The camera most cases are seen by: at the origin, along +z."""
    return front_camera(45, 39)


def around(axis: int, degrees: float) -> tuple[float, ...]:
    """A quaternion, wxyz."""
    quat = [float(np.cos(np.radians(degrees) / 2)), 0.0, 0.0, 0.0]
    quat[1 + axis] = float(np.sin(np.radians(degrees) / 2))
    return tuple(quat)


def decimal_case(name: str, answer: str, scene: Gaussians) -> Case:
    """A case held to 60 digits at every pixel."""

    def run() -> Outcome:
        found, right = render(scene, view()).alpha, exact_alpha(scene, view())
        apart = np.abs(found - right)
        apart[np.abs(right - 1 / 255) < RIM] = 0.0
        return Outcome(float(found.mean()), float(right.mean()), "60 digits", float(apart.max()), 1e-5)

    return Case(name, answer, run)


def layers(count: int, opacity: float) -> Gaussians:
    """Gaussians without end, one behind another."""
    means = np.column_stack([np.zeros((count, 2)), np.linspace(2.0, 40.0, count)])
    return gaussians(means, scales=1e3, opacity_logits=np.log(opacity / (1 - opacity)))


def rims(count: int = 400) -> Gaussians:
    """Gaussians whose alpha passes 1/255 within a millionth of their opacity, side by side."""
    rng = np.random.default_rng(0)
    opacity = (1 + rng.uniform(-1e-6, 1e-6, count)) / 255
    means = np.column_stack([rng.uniform(-1.5, 1.5, (count, 2)), np.full(count, 3.0)])
    return gaussians(means, scales=5.0, opacity_logits=np.log(opacity / (1 - opacity)))


def near_the_stop() -> Gaussians:
    """Four layers of alpha 0.9 leave 1e-4, the very transmittance at which a pixel stops; a bright one lies behind."""
    means = [[0, 0, 2.0 + k / 10] for k in range(5)]
    colors = [[0.5] * 3] * 4 + [[1.0, 0.0, 0.0]]
    return gaussians(
        means, scales=[[0.3] * 3] * 4 + [[3.0] * 3], opacity_logits=[np.log(9.0)] * 4 + [3.0], colors=colors
    )


def _empty(rendering) -> float:
    return float((rendering.dominant >= 0).sum() + rendering.alpha.sum() + rendering.depth.sum())


Z45 = around(2, 45)
NEEDLE = [1000.0, 1e-6, 1e-6]

GAUSSIAN_CASES: tuple[Case, ...] = (
    decimal_case(
        "needle of 1e-6 x 1000 m at 45 degrees",
        "a line one pixel wide: the determinant must not cancel",
        gaussians([[0.1, 0, 3.0]], scales=NEEDLE, quats=Z45),
    ),
    decimal_case(
        "needle of 1e-6 x 1000 m at 1 degree", "same", gaussians([[0.1, 0, 3.0]], scales=NEEDLE, quats=around(2, 1))
    ),
    decimal_case(
        "needle of 1e-6 x 1 m at 45 degrees", "same", gaussians([[0.1, 0, 3.0]], scales=[1.0, 1e-6, 1e-6], quats=Z45)
    ),
    decimal_case(
        "needle along the view axis",
        "a dot, drawn out only by perspective",
        gaussians([[0.1, 0.05, 3.0]], scales=[1e-6, 1e-6, 10.0]),
    ),
    decimal_case(
        "axis-aligned covariance",
        "an upright ellipse: no eigenvectors needed",
        gaussians([[0.0, 0, 3.0]], scales=[0.3, 0.1, 0.2]),
    ),
    decimal_case("flat disc, edge on", "a line one pixel wide", gaussians([[0.0, 0.1, 3.0]], scales=[1.0, 0.0, 1.0])),
    decimal_case(
        "flat disc, tilted", "an ellipse", gaussians([[0.0, 0.1, 3.0]], scales=[0.5, 0.0, 0.5], quats=around(0, 30))
    ),
    decimal_case(
        "quaternion of norm 1e25",
        "same as of norm 1",
        gaussians([[0, 0, 3.0]], scales=[0.5, 0.1, 0.1], quats=np.array(around(2, 30)) * 1e25),
    ),
    decimal_case(
        "quaternion of norm 1e-25",
        "same as of norm 1",
        gaussians([[0, 0, 3.0]], scales=[0.5, 0.1, 0.1], quats=np.array(around(2, 30)) * 1e-25),
    ),
    image_case(
        "scale 0",
        "a point: the low-pass alone, alpha 0.99 exp(-r^2 / 0.6)",
        lambda: gaussians([[0.0, 0.0, 3.0]], scales=0.0, opacity_logits=np.inf),
        view,
        lambda r: r.alpha[19, 23],
        float(np.exp(-0.5 / 0.3)),
    ),
    image_case(
        "scale 1e6 m",
        "every pixel has the opacity, 0.5",
        lambda: gaussians([[0.3, 0.1, 3.0]], scales=1e6, opacity_logits=0.0),
        view,
        mean_alpha,
        0.5,
    ),
    image_case(
        "scale 5e34 m, the largest accepted",
        "every pixel has the opacity, 0.5",
        lambda: gaussians([[0.3, 0.1, 3.0]], scales=5e34, opacity_logits=0.0),
        view,
        mean_alpha,
        0.5,
    ),
    image_case(
        "mean at the edge of float32",
        "far and huge, but finite",
        lambda: gaussians([[0, 0, 1e30], [1e30, 0, 3.0]], scales=1e20),
        view,
    ),
    image_case("behind the camera", "nothing", lambda: gaussians([[0, 0, -3.0]], scales=5.0), view, _empty, 0.0),
    image_case("at the near plane, 0.2 m", "nothing", lambda: gaussians([[0, 0, 0.2]]), view, _empty, 0.0),
    image_case("0.1 mm behind the near plane", "drawn", lambda: gaussians([[0, 0, 0.2001]], scales=0.05), view),
    image_case("mean at the camera centre", "nothing", lambda: gaussians([[0, 0, 0.0]], scales=0.5), view, _empty, 0.0),
    image_case(
        "long and outside the frustum (fan)",
        "as the clamped Jacobian says, on every pixel",
        lambda: gaussians([[9.0, 0, 3.0]], scales=[4.0, 0.1, 0.1], opacity_logits=3.0),
        view,
    ),
    image_case(
        "far outside the clamp",
        "as the clamped Jacobian says",
        lambda: gaussians([[30.0, 0.2, 1.0]], scales=12.0, opacity_logits=3.0),
        view,
    ),
    image_case(
        "equal depths",
        "the lower id is in front",
        lambda: gaussians([[x / 100, 0, 3.0] for x in range(-5, 5)], colors=np.eye(3)[np.arange(10) % 3]),
        view,
        lambda r: r.dominant.max(),
        9.0,
    ),
    image_case(
        "depths one float32 step apart",
        "the nearer one wins, though its id is higher",
        lambda: gaussians([[0, 0, np.nextafter(np.float32(1000.0), np.float32(2e3))], [0, 0, 1000.0]], scales=100.0),
        view,
        lambda r: r.dominant[19, 22],
        1.0,
    ),
    image_case(
        "depths from 0.25 to 1e8 m, and behind",
        "nearest first: neither quantised nor signed bits",
        lambda: gaussians(
            [[0, 0, z] for z in (1e8, -1.0, 1e3, 0.25, 1e6)],
            scales=[[1e8] * 3, [9.0] * 3, [1e3] * 3, [0.25] * 3, [1e6] * 3],
        ),
        view,
        lambda r: r.dominant[19, 22],
        3.0,
    ),
    image_case("opacity 0", "nothing", lambda: gaussians([[0, 0, 2.0]], opacity_logits=-np.inf), view, _empty, 0.0),
    image_case(
        "opacity just under 1/255",
        "nothing: the extent is the root of a negative number",
        lambda: gaussians([[0, 0, 2.0]], opacity_logits=np.log(1 / 254.2)),
        view,
        _empty,
        0.0,
    ),
    image_case(
        "opacity just over 1/255",
        "a few faint pixels",
        lambda: gaussians([[0, 0, 2.0]], opacity_logits=np.log(1 / 253.0)),
        view,
    ),
    image_case(
        "opacity 1, nine in a row",
        "capped at 0.99: two would leave 1e-4 (float32: a little less), so one is drawn",
        lambda: gaussians([[0, 0, 2.0 + k / 10] for k in range(9)], scales=90.0, opacity_logits=np.inf),
        view,
        mean_alpha,
        0.99,
    ),
    image_case(
        "20,000 layers of alpha 0.004",
        "1 - 0.996^n, until the pixel stops at 1e-4: n = 2297",
        lambda: layers(20_000, 0.004),
        lambda: front_camera(3, 3),
        mean_alpha,
        1 - 0.996**2297,
        tolerance=2e-6,
    ),
    image_case(
        "SH of 1e4 and -1e4",
        "max(0, sum): no upper clamp",
        lambda: gaussians([[0, 0, 3.0], [0.1, 0, 4.0]], colors=[[1e4, -1e4, 0], [0, 1e4, -1e4]]),
        view,
        lambda r: r.color[..., 0].max() / 1e4,
    ),
    image_case(
        "no Gaussians",
        "the background",
        lambda: gaussians(np.empty((0, 3))),
        view,
        lambda r: r.color.sum(),
        45 * 39 * 1.5,
        background=(0.25, 0.5, 0.75),
    ),
    image_case(
        "depth of half a wall at 4 m",
        "4 m: the sum is divided by alpha",
        lambda: gaussians([[0, 0, 4.0]], scales=1e3, opacity_logits=0.0),
        view,
        lambda r: r.depth[19, 22],
        4.0,
    ),
    image_case("400 alphas within a millionth of 1/255", "each may flip: the mean stays", rims, view, tolerance=0.05),
    image_case(
        "transmittance at 1e-4",
        "pixels where it falls on the limit may flip: their share is bounded",
        near_the_stop,
        view,
    ),
)
