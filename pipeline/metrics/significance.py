"""How sure a mean or a difference is: bootstrap intervals that respect scenes, and paired permutation tests.

Questions of one scene share its views and its faults, so they are not independent. The clustered bootstrap draws
scenes with replacement and then, within each drawn scene, its questions with replacement; every draw's mean is over all
its questions, so large scenes weigh more, as they do in the reported mean.

With few scenes this interval is itself unsure: three scenes have ten different draws, and nothing can be learnt from
them about a fourth. Intervals therefore say how many scenes they rest on, `few_scenes` marks those below
`FEW_SCENES`, and `by_scene=False` gives the plain bootstrap over questions, which speaks about these scenes only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

RESAMPLES = 2_000
"""Draws of a bootstrap: the ends of a 95 % interval then vary by a few per cent of its width."""

FEW_SCENES = 10
"""Below this many scenes a clustered interval is marked: percentile intervals over so few clusters are too narrow."""

EXACT_PAIRS = 12
"""Up to this many sign flips a permutation test visits all of them."""

CHUNK = 4_000_000
"""Numbers drawn at once: bounds the memory, about 64 MB."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean and the range it would fall in were the questions drawn again."""

    mean: float | None
    """Mean of the values; None for no value."""
    low: float | None
    """Lower end; None for fewer than two values, which say nothing of spread."""
    high: float | None
    """Upper end; None likewise."""
    n: int
    """Values."""
    scenes: int
    """Distinct scenes among them."""
    by_scene: bool
    """Whether scenes were drawn; False for the plain bootstrap, and always with one scene."""

    @property
    def few_scenes(self) -> bool:
        """Whether scenes were drawn from too few to trust the ends."""
        return self.by_scene and self.scenes < FEW_SCENES


def bootstrap_interval(
    values: Float[np.ndarray, "n"],
    scenes: Sequence[str],
    rng: np.random.Generator,
    *,
    by_scene: bool = True,
    level: float = 0.95,
    resamples: int = RESAMPLES,
) -> Interval:
    """Return the mean of values with its percentile bootstrap interval.

    For two arms on the same questions give the differences: questions vary far more than arms do.

    Args:
        values: One a question, finite.
        scenes: Scene of each value.
        rng: Source of draws; the same state gives the same interval.
        by_scene: Draw scenes, then questions within them; False draws questions only. With a single scene there is
            nothing to draw among, and questions are drawn.
        level: Share of draws inside the interval, between 0 and 1.
        resamples: Number of draws.
    """
    values = np.asarray(values, np.float64)
    names, owner = np.unique(np.asarray(scenes, dtype=object).astype(str), return_inverse=True)
    if len(owner) != len(values):
        raise ValueError(f"bootstrap_interval needs one scene a value, got {len(values)} and {len(owner)}")
    by_scene = by_scene and len(names) > 1
    if len(values) < 2:
        mean = float(values[0]) if len(values) else None
        return Interval(mean, None, None, len(values), len(names), by_scene)
    groups = [values[owner == scene] for scene in range(len(names))] if by_scene else [values]
    means = _draw_means(groups, rng, resamples)
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2])
    return Interval(float(values.mean()), float(low), float(high), len(values), len(names), by_scene)


def permutation_p(
    first: Float[np.ndarray, "n"],
    second: Float[np.ndarray, "n"],
    rng: np.random.Generator,
    *,
    scenes: Sequence[str] | None = None,
    resamples: int = 10_000,
) -> float | None:
    """Return the two-sided p value of a paired permutation test of equal means.

    Under the null hypothesis each difference is as likely to have the other sign. Up to `EXACT_PAIRS` flips all
    combinations are visited; beyond, `resamples` random ones, and the observed one counts among them, so p is never 0.

    Args:
        first: Scores of one arm, NaN where unscored.
        second: Scores of the other arm, in the same order.
        rng: Source of draws.
        scenes: Scene of each question, to flip whole scenes together; None flips each question by itself. With S
            scenes the least possible p is 2^(1-S).
        resamples: Number of random flips.

    Returns:
        p between 0 and 1; None when no question has both scores; 1 when all differences are 0.
    """
    difference = np.asarray(second, np.float64) - np.asarray(first, np.float64)
    kept = np.isfinite(difference)
    difference = difference[kept]
    if not len(difference):
        return None
    if scenes is not None:
        _, owner = np.unique(np.asarray(scenes, dtype=object).astype(str)[kept], return_inverse=True)
        difference = np.array([difference[owner == scene].sum() for scene in range(owner.max() + 1)])
    difference = difference[difference != 0]
    n = len(difference)
    if n == 0:
        return 1.0
    observed = abs(difference.sum())
    # Sums of the same numbers in another order may differ in the last bits.
    least = observed - 1e-9 * np.abs(difference).sum()
    if n <= EXACT_PAIRS:
        every = 1.0 - 2.0 * (np.arange(2**n)[:, None] >> np.arange(n) & 1)
        return float((np.abs(every @ difference) >= least).mean())
    hits, chunk = 0, max(1, CHUNK // n)
    for start in range(0, resamples, chunk):
        signs = 1 - 2 * rng.integers(0, 2, (min(chunk, resamples - start), n), dtype=np.int8)
        hits += int((np.abs(signs @ difference) >= least).sum())
    return (1 + hits) / (1 + resamples)


def _draw_means(
    groups: Sequence[Float[np.ndarray, "_"]], rng: np.random.Generator, resamples: int
) -> Float[np.ndarray, "resamples"]:
    """Means of `resamples` draws: as many groups as there are, with replacement, and then their values likewise."""
    scenes = len(groups)
    drawn = rng.integers(0, scenes, (resamples, scenes)) + np.arange(resamples)[:, None] * scenes
    times = np.bincount(drawn.ravel(), minlength=resamples * scenes).reshape(resamples, scenes)
    total = np.zeros(resamples)
    count = np.zeros(resamples)
    for index, group in enumerate(groups):
        draw = np.repeat(np.arange(resamples), times[:, index])
        rows = max(1, CHUNK // len(group))
        for start in range(0, len(draw), rows):
            part = draw[start : start + rows]
            picked = rng.integers(0, len(group), (len(part), len(group)))
            total += np.bincount(part, weights=group[picked].sum(axis=1), minlength=resamples)
            count += np.bincount(part, minlength=resamples) * len(group)
    return total / count
