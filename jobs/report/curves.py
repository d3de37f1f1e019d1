"""Plots with two axes as inline SVG: a curve that only grows, and dots of groups."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from jobs.report.plots import round_up, short_number, ticks

WIDTH, HEIGHT = 420, 230
LEFT, RIGHT, TOP, BOTTOM = 58, 14, 12, 40


@dataclass(frozen=True, slots=True)
class Axis:
    """What an axis measures."""

    label: str
    """Written beside it."""
    top: float
    """Largest value shown."""


@dataclass(frozen=True, slots=True)
class Dot:
    """One group of questions."""

    x: float
    """Its value along x."""
    y: float
    """Its value along y."""
    text: str
    """What it is, for its tooltip."""
    series: int
    """Colour, 0-based."""
    weight: float = 1.0
    """Its size, 0 to 1."""


def growth_plot(points: Sequence[tuple[float, float]], x: str, y: str, describe: str) -> str:
    """Return a curve through points whose x and y never fall, filled below.

    Args:
        points: At least two.
        x: What x is.
        y: What y is.
        describe: What the plot shows, for people who cannot see it.
    """
    axes = Axis(x, round_up(points[-1][0])), Axis(y, round_up(points[-1][1]))
    # A dot in each pixel is all that can be seen.
    step = max(1, len(points) // (WIDTH // 2))
    kept = [*points[:-1:step], points[-1]]
    line = "L".join(f"{_x(a, axes[0]):.1f} {_y(b, axes[1]):.1f}" for a, b in kept)
    floor = _y(0, axes[1])
    shape = f"M{_x(kept[0][0], axes[0]):.1f} {floor}L{line}L{_x(kept[-1][0], axes[0]):.1f} {floor}Z"
    body = f'<path class="area" d="{shape}"/><path class="curve" d="M{line}"/>'
    return _framed(body, axes, describe)


def dot_plot(dots: Sequence[Dot], x: str, y: str, describe: str) -> str:
    """Return dots; arguments are those of `growth_plot`."""
    axes = Axis(x, round_up(max(dot.x for dot in dots))), Axis(y, round_up(max(dot.y for dot in dots)))
    body = "".join(
        f'<circle class="s{dot.series}" cx="{_x(dot.x, axes[0]):.1f}" cy="{_y(dot.y, axes[1]):.1f}" '
        f'r="{3 + 5 * math.sqrt(dot.weight):.1f}"><title>{escape(dot.text)}</title></circle>'
        for dot in dots
    )
    return _framed(body, axes, describe)


def _framed(body: str, axes: tuple[Axis, Axis], describe: str) -> str:
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(describe)}" class="plot">',
        f"<title>{escape(describe)}</title>",
    ]
    for tick in ticks(axes[0].top):
        x = _x(tick, axes[0])
        parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>')
        parts.append(f'<text class="tick" x="{x:.1f}" y="{HEIGHT - BOTTOM + 15}" text-anchor="middle">')
        parts.append(f"{short_number(tick)}</text>")
    for tick in ticks(axes[1].top):
        y = _y(tick, axes[1])
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text class="tick" x="{LEFT - 6}" y="{y + 3:.1f}" text-anchor="end">{short_number(tick)}</text>')
    middle = (TOP + HEIGHT - BOTTOM) / 2
    parts.append(f'<text class="tick" x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 6}" text-anchor="middle">')
    parts.append(f"{escape(axes[0].label)}</text>")
    parts.append(f'<text class="tick" transform="translate(13 {middle}) rotate(-90)" text-anchor="middle">')
    return "".join([*parts, f"{escape(axes[1].label)}</text>", body, "</svg>"])


def _x(value: float, axis: Axis) -> float:
    return LEFT + (WIDTH - LEFT - RIGHT) * value / axis.top


def _y(value: float, axis: Axis) -> float:
    return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * value / axis.top
