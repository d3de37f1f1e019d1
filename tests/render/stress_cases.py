"""What a stress case is, and the list of all of them: shared by the tests and by `benchmarks/stress.py`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.geometry import Camera
from pipeline.render import Rendering, render, render_reference
from pipeline.scene.gaussians import Gaussians

LARGEST_RMS = 10 ** (-90 / 20)
"""Issue 3's 90 dB, as a root mean square; colours are divided by the brightest one where it is above 1."""
LARGEST_FLIPPED = 2e-3
"""Share of pixels whose dominant Gaussian may differ: on a rim, alpha may fall on either side of 1/255."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a case gave."""

    ours: float | str
    """The number (or word) the case looks at, from our renderer."""
    right: float | str
    """What it should be."""
    source: str
    """Where the right number comes from: float64, 60 digits, by hand."""
    error: float
    """|ours - right| (1 for a wrong word)."""
    limit: float
    """Largest error allowed."""
    rms: float = 0.0
    """Root mean square against the float64 reference over colour and alpha, whichever is larger."""
    flipped: float = 0.0
    """Share of pixels whose dominant Gaussian differs from the reference's."""

    def failures(self) -> list[str]:
        """One line for every bound that does not hold; not-a-number never holds."""
        lines = []
        if not self.error <= self.limit:
            lines.append(f"{self.ours} instead of {self.right} ({self.source}): off by {self.error}, over {self.limit}")
        if not self.rms <= LARGEST_RMS:
            lines.append(f"rms {self.rms:.2e} against float64, over {LARGEST_RMS:.2e}")
        if not self.flipped <= LARGEST_FLIPPED:
            lines.append(f"dominant differs on {self.flipped:.4%} of the pixels, over {LARGEST_FLIPPED:.2%}")
        return lines


@dataclass(frozen=True, slots=True)
class Case:
    """One way to break a renderer."""

    name: str
    answer: str
    """The right answer, in words."""
    run: Callable[[], Outcome]
    slow: bool = False
    """Takes seconds: left out of the default tests."""


def image_case(
    name: str,
    answer: str,
    scene: Callable[[], Gaussians],
    view: Callable[[], Camera],
    probe: Callable[[Rendering], float] | None = None,
    right: float | None = None,
    *,
    tolerance: float = 1e-4,
    **options: object,
) -> Case:
    """A case that is rendered by both; `probe` picks its number (the mean alpha unless given).

    Args:
        name: Name of the case.
        answer: The right answer.
        scene: Builds the Gaussians.
        view: Builds the camera.
        probe: The number looked at.
        right: Its value by hand; None for the reference's.
        tolerance: Largest difference of the two, relative where the value is above 1.
        **options: Passed to both renderers.
    """

    def run() -> Outcome:
        gaussians, camera, look = scene(), view(), probe or mean_alpha
        found, truth = render(gaussians, camera, **options), render_reference(gaussians, camera, **options)
        ours, expected = float(look(found)), float(look(truth)) if right is None else right
        return Outcome(
            ours=ours,
            right=expected,
            source="float64" if right is None else "by hand",
            error=abs(ours - expected) / max(1.0, abs(expected)),
            limit=tolerance,
            rms=rms(found, truth),
            flipped=float(np.mean(found.dominant != truth.dominant)),
        )

    return Case(name, answer, run)


def word_case(name: str, answer: str, ours: Callable[[], str], right: str) -> Case:
    """A case whose answer is a word: what was refused, what was dropped."""

    def run() -> Outcome:
        word = ours()
        return Outcome(word, right, "by hand", float(word != right), 0.0)

    return Case(name, answer, run)


def mean_alpha(rendering: Rendering) -> float:
    """Mean alpha over the image."""
    return float(rendering.alpha.mean(dtype=np.float64))


def rms(found: Rendering, truth: Rendering) -> float:
    """Root mean square error of colour (scaled to at most 1) and alpha, the larger; infinite if not finite."""
    scale = max(1.0, float(np.abs(truth.color).max()))
    errors = []
    for ours, right in ((found.color / scale, truth.color / scale), (found.alpha, truth.alpha)):
        errors.append(float(np.sqrt(np.mean((ours.astype(np.float64) - right) ** 2))))
    finite = all(np.isfinite(image).all() for image in (found.color, found.alpha, found.depth, found.dominant_weight))
    return max(errors) if finite else float("inf")


def all_cases() -> tuple[Case, ...]:
    """Every case, in the order of the table in docs/rendering.md."""
    from tests.render.stress_gaussians import GAUSSIAN_CASES
    from tests.render.stress_inputs import INPUT_CASES
    from tests.render.stress_views import VIEW_CASES

    return (*INPUT_CASES, *GAUSSIAN_CASES, *VIEW_CASES)
