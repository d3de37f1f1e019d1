"""Points of error against time, as a table and as the Pareto plot."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.render_errors import Point

BEST_DB = 120.0
"""Equal images are shown with this PSNR."""


def table(points: list[Point]) -> str:
    lines = [
        f"{'knob':30} {'colour ms':>9} {'ratio':>6} {'dominance':>9} {'ratio':>6} {'PSNR dB':>8} {'SSIM':>7} "
        f"{'same id':>9} {'|dS|':>7} {'best view':>9} {'regret':>7}"
    ]
    for p in points:
        e = p.errors
        lines.append(
            f"{p.name:30} {p.color_ms:9.2f} {p.color_ratio:6.2f} {p.dominance_ms:9.2f} "
            f"{p.dominance_ratio:6.2f} {min(e.psnr_db, BEST_DB):8.1f} {e.ssim:7.4f} "
            f"{100 * e.same_dominant:7.2f} % {e.score_error:7.4f} {100 * e.same_best_view:7.1f} % "
            f"{100 * e.regret:5.2f} %"
        )
    return "\n".join(lines)


def pareto_front(time: np.ndarray, error: np.ndarray) -> list[int]:
    """Points that no other point beats in one without losing in the other."""
    return [
        k
        for k in range(len(time))
        if not ((time <= time[k]) & (error <= error[k]) & ((time < time[k]) | (error < error[k]))).any()
    ]


def plot(points: list[Point], path: Path, title: str) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(12, 5), constrained_layout=True)
    rest = points[1:]
    panels = (
        ([p.color_ratio for p in rest], [min(p.errors.psnr_db, BEST_DB) for p in rest], -1),
        ([p.dominance_ratio for p in rest], [max(p.errors.score_error, 1e-5) for p in rest], 1),
    )
    for axis, (x, y, sign) in zip(axes, panels, strict=True):
        order = sorted(pareto_front(np.array(x), sign * np.array(y)), key=lambda k: x[k])
        axis.scatter(x, y, s=16, color="0.6")
        axis.plot([x[k] for k in order], [y[k] for k in order], "o-", color="tab:blue", markersize=5, linewidth=1)
        height = np.log10(y) if sign > 0 else np.array(y)
        spread = np.column_stack([x / np.ptp(x), height / np.ptp(height)])
        labelled: list[int] = []
        for k in [*order, *(k for k in range(len(x)) if k not in order)]:
            # A label that would lie on another is left out: the table has them all.
            if all(abs(spread[k] - spread[j])[1] > 0.035 or abs(spread[k] - spread[j])[0] > 0.25 for j in labelled):
                labelled.append(k)
                name, tone = rest[k].name, "black" if k in order else "0.5"
                axis.annotate(name, (x[k], y[k]), fontsize=6, color=tone, xytext=(4, 3), textcoords="offset points")
        axis.axvline(1.0, color="0.8", linewidth=0.8, zorder=0)
        axis.set_xlabel("time as a share of the exact frame's")
        # Names stand to the right of their points.
        axis.set_xlim(min(x) - 0.1 * np.ptp(x), max(x) + 0.2 * np.ptp(x))
        axis.margins(y=0.08)
    axes[0].set_ylabel(f"PSNR, dB (cut at {BEST_DB:.0f})")
    axes[1].set_ylabel("mean error of S_vis (at least 1e-5)")
    axes[1].set_yscale("log")
    axes[0].set_title("colour, depth and alpha", fontsize=10)
    axes[1].set_title("dominance only", fontsize=10)
    figure.suptitle(title + "; blue: the Pareto front", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
