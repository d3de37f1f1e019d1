"""Plots as inline SVG: horizontal bars with intervals. Colours come from the page's style, so both themes fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

WIDTH = 420
LABEL_WIDTH = 142
VALUE_WIDTH = 58
LABEL_CHARS = 24
"""Longest label drawn; the whole one is in its tooltip."""
BAR = 13
GAP = 8
TOP = 8
AXIS = 24


@dataclass(frozen=True, slots=True)
class Bar:
    """One bar."""

    value: float | None
    """Its length; None draws nothing but a dash."""
    low: float | None = None
    """Lower end of its interval."""
    high: float | None = None
    """Upper end of its interval."""
    text: str = ""
    """Written behind it; empty writes the value."""


@dataclass(frozen=True, slots=True)
class BarGroup:
    """Bars that share a label."""

    label: str
    """What they are about."""
    bars: tuple[Bar, ...]
    """One a series."""


def bar_plot(
    groups: Sequence[BarGroup],
    series: Sequence[str],
    describe: str,
    *,
    stacked: bool = False,
) -> str:
    """Return an SVG of horizontal bars.

    Args:
        groups: From top to bottom; each with one bar a series.
        series: Names, for tooltips; the bars get the classes s0, s1, ... in this order.
        describe: What the plot shows, for people who cannot see it.
        stacked: Put a group's bars end to end instead of below each other.
    """
    totals = [sum(bar.value or 0 for bar in group.bars) if stacked else _reach(group.bars) for group in groups]
    top = round_up(max(totals, default=0))
    scale = (WIDTH - LABEL_WIDTH - VALUE_WIDTH) / top
    rows = 1 if stacked else max(1, len(series))
    height = TOP + len(groups) * (rows * BAR + GAP) + AXIS
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{escape(describe)}" class="plot">',
        f"<title>{escape(describe)}</title>",
    ]
    for tick in ticks(top):
        x = LABEL_WIDTH + tick * scale
        parts.append(f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{height - AXIS}"/>')
        parts.append(
            f'<text class="tick" x="{x:.1f}" y="{height - 8}" text-anchor="middle">{short_number(tick)}</text>'
        )
    y = float(TOP)
    for group in groups:
        middle = y + (rows * BAR) / 2 + 4
        short = group.label if len(group.label) <= LABEL_CHARS else group.label[: LABEL_CHARS - 1] + "…"
        parts.append(
            f'<text class="label" x="{LABEL_WIDTH - 8}" y="{middle:.1f}" text-anchor="end">{escape(short)}'
            f"<title>{escape(group.label)}</title></text>"
        )
        parts += _stack(group, series, y, scale) if stacked else _rows(group, series, y, scale)
        y += rows * BAR + GAP
    return "".join([*parts, "</svg>"])


def _rows(group: BarGroup, series: Sequence[str], y: float, scale: float) -> list[str]:
    parts = []
    for place, (bar, name) in enumerate(zip(group.bars, series, strict=True)):
        top = y + place * BAR
        text = bar.text or ("–" if bar.value is None else short_number(bar.value))
        tip = f"{group.label}, {name}: {text}" if name else f"{group.label}: {text}"
        end = bar.value or 0.0
        if bar.value is not None:
            parts.append(_rect(place, LABEL_WIDTH, top, bar.value * scale, tip))
        if bar.low is not None and bar.high is not None:
            a, b, middle = LABEL_WIDTH + bar.low * scale, LABEL_WIDTH + bar.high * scale, top + BAR / 2 - 0.5
            parts.append(
                f'<path class="whisker" d="M{a:.1f} {middle}H{b:.1f}M{a:.1f} {middle - 3}v6M{b:.1f} {middle - 3}v6"/>'
            )
            end = max(end, bar.high)
        x = LABEL_WIDTH + end * scale + 5
        parts.append(f'<text class="value" x="{x:.1f}" y="{top + BAR - 2:.1f}">{escape(text)}</text>')
    return parts


def _stack(group: BarGroup, series: Sequence[str], y: float, scale: float) -> list[str]:
    parts, x = [], float(LABEL_WIDTH)
    for place, (bar, name) in enumerate(zip(group.bars, series, strict=True)):
        if bar.value:
            parts.append(_rect(place, x, y, bar.value * scale, f"{group.label}, {name}: {short_number(bar.value)}"))
            x += bar.value * scale
    text = " + ".join(short_number(bar.value or 0) for bar in group.bars)
    parts.append(f'<text class="value" x="{x + 5:.1f}" y="{y + BAR - 2:.1f}">{escape(text)}</text>')
    return parts


def _rect(series: int, x: float, y: float, width: float, tip: str) -> str:
    shape = f'x="{x:.1f}" y="{y:.1f}" width="{max(width, 0):.1f}" height="{BAR - 1}"'
    return f'<rect class="s{series}" {shape}><title>{escape(tip)}</title></rect>'


def _reach(bars: Sequence[Bar]) -> float:
    return max((max(bar.value or 0.0, bar.high or 0.0) for bar in bars), default=0.0)


def round_up(value: float) -> float:
    """Return the least of 1, 2, 5 times a power of ten that is not below the value."""
    if value <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value)


def ticks(top: float) -> list[float]:
    """Return even steps from 0 to the top of an axis."""
    steps = 4 if math.isclose(top / 10 ** math.floor(math.log10(top)), 2) else 5
    return [top * step / steps for step in range(steps + 1)]


def short_number(value: float) -> str:
    """Return a number with about two digits."""
    if value >= 10_000:
        return f"{value / 1e6:.3g}M" if value >= 1e6 else f"{value / 1e3:.3g}k"
    if value >= 100 or value == int(value):
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 10 else f"{value:.2g}"
