"""Takes every figure of docs/rendering.md again: the commands named there, one after another, on a quiet machine.

    python -m benchmarks.rendering_figures --output FOLDER [--yardstick FOLDER] [--plots docs/images]

Every command's output goes to a file in the folder. What needs the yardstick or the showroom is left out without it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.render import ROOT, showroom_folder


def commands(yardstick: Path | None, plots: Path, real: bool) -> dict[str, list[str]]:
    """Arguments of `python -m` by the name of the file that takes their output."""
    scenes = ["100k", "500k", *(["showroom"] if real else [])]
    beside = ["--yardstick", str(yardstick.resolve())] if yardstick else []
    found = {
        "speed": ["benchmarks.render", *beside, "--scenes", *scenes],
        "compile": ["benchmarks.render", "--compile"],
        "cost_curves": [
            "benchmarks.cost_curves", "--largest", "5_000_000", "--plot", str(plots / "cost_curves.png")
        ],
        "error_apartment": ["benchmarks.error_vs_time", "--plot", str(plots / "error_vs_time.png")],
        "stress": ["benchmarks.stress", "--markdown"],
    }  # fmt: skip
    if real:
        found["poses"] = [
            "benchmarks.render",
            "--scenes",
            "showroom",
            "--poses",
            "300",
            "--repeats",
            "1",
            "--threads",
            "1",
        ]
        found["error_showroom"] = ["benchmarks.error_vs_time", "--scene", "showroom"]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, required=True, help="folder for the outputs")
    parser.add_argument("--yardstick", type=Path, help="folder with floor.py")
    parser.add_argument("--plots", type=Path, help="folder for the two plots; the output folder if not given")
    options = parser.parse_args()
    output = options.output.resolve()
    output.mkdir(parents=True, exist_ok=True)
    plots = options.plots.resolve() if options.plots else output
    real = showroom_folder().is_dir()
    if not real:
        print(f"no showroom at {showroom_folder()}: its figures are left out")
    failed = []
    for name, command in commands(options.yardstick, plots, real).items():
        start = time.perf_counter()
        with (output / f"{name}.txt").open("w") as file:
            outcome = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, stdout=file, check=False)
        print(f"{name:16} {time.perf_counter() - start:6.0f} s   exit code {outcome.returncode}", flush=True)
        failed += [name] if outcome.returncode else []
    sys.exit(f"failed: {', '.join(failed)}" if failed else 0)


if __name__ == "__main__":
    main()
