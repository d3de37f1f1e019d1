"""The stress list as a table: case, ours, the right number and where it comes from, error.

    python -m benchmarks.stress             # all cases; exits with 1 if one fails
    python -m benchmarks.stress --markdown  # the table of docs/rendering.md

The cases are those of tests/render/test_stress.py. `rms` is over colour and alpha against the float64 reference,
`flipped` the share of pixels whose dominant Gaussian differs from the reference's.
"""

from __future__ import annotations

import argparse
import sys

from tests.render.stress_cases import all_cases


def shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.7g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true")
    options = parser.parse_args()
    rows, failed = [], []
    for case in all_cases():
        outcome = case.run()
        failed += [f"{case.name}: {line}" for line in outcome.failures()]
        rows.append((case.name, case.answer, shown(outcome.ours), shown(outcome.right), outcome.source,
                     f"{outcome.error:.1e}", f"{outcome.rms:.1e}", f"{100 * outcome.flipped:.3f} %"))  # fmt: skip
    head = ("case", "right answer", "ours", "reference", "source", "error", "rms", "flipped")
    if options.markdown:
        print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
        for row in rows:
            print("| " + " | ".join(row) + " |")
    else:
        print(f"{head[0]:42} {head[2]:>24} {head[3]:>24} {head[4]:9} {head[5]:>8} {head[6]:>8} {head[7]:>9}")
        for name, _, ours, right, source, error, rms, flipped in rows:
            print(f"{name:42} {ours[:24]:>24} {right[:24]:>24} {source:9} {error:>8} {rms:>8} {flipped:>9}")
    for line in failed:
        print("FAILED", line, file=sys.stderr)
    print(f"\n{len(rows)} cases, {len(failed)} failures", file=sys.stderr)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
