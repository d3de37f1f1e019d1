"""Where novel views and verification gain and lose, by how sure the answers sounded.

    splatreasoner demo --scenes 12 --output runs/ablation
    python benchmarks/ablation.py runs/ablation/run

Reads results/arms.parquet of a run answered by the symbolic model, whose wording tells how sure it is.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd

SCORES = {"eqa": "mark", "ground_one": "iou", "ground_many": "iou"}
CHANGED = 1e-9


def sureness(answer: str) -> str:
    """Return how sure an answer of the symbolic model sounds."""
    lowered = answer.lower()
    if "cannot tell" in lowered or "do not see" in lowered:
        return "unknown"
    return "hedged" if "looks like" in lowered else "definite"


def by_arm(arms: pd.DataFrame, task: str) -> pd.DataFrame:
    """Return one row a scored question: score and answer in each arm."""
    part = arms[arms["task"] == task]
    wide = part.pivot(index="question_id", columns="arm", values=[SCORES[task], "answer"])
    wide.columns = [f"{arm}_{'score' if value != 'answer' else 'answer'}" for value, arm in wide.columns]
    return wide.dropna()


def moves(table: pd.DataFrame, before: str, after: str) -> pd.DataFrame:
    """Return, by sureness before and after, how many answers differ and how the score moved."""
    changed = table[table[f"{before}_answer"] != table[f"{after}_answer"]]
    step = (changed[f"{after}_score"] - changed[f"{before}_score"]).astype(float)
    frame = pd.DataFrame(
        {
            before: changed[f"{before}_answer"].map(sureness),
            after: changed[f"{after}_answer"].map(sureness),
            "change": step,
            "gained": step > CHANGED,
            "lost": step < -CHANGED,
        }
    )
    return frame.groupby([before, after]).agg(
        questions=("change", "size"), mean_change=("change", "mean"), gained=("gained", "sum"), lost=("lost", "sum")
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="run folder")
    arms = pd.read_parquet(parser.parse_args().run / "results" / "arms.parquet")
    for task, score in SCORES.items():
        table = by_arm(arms, task)
        for before, after in (("initial", "final"), ("final", "verified")):
            print(f"\n{task}: {before} to {after}, {len(table)} questions, {score}; answers that differ:")
            print(moves(table, before, after).round(2).to_string())


if __name__ == "__main__":
    main()
