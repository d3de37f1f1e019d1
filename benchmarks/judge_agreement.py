"""How far another judge agrees with the one that marked a run.

    python -m benchmarks.judge_agreement RUN examples/local.yaml --endpoint local

Draws marked answers of the run, of any arm, as many of each mark as there are, and has them marked again by an endpoint
of the job file: prompt, parser and asking again are those of a job, and nothing is stored. Prints every item as it is
marked, then the agreement. In the balanced draw rare marks count as much as common ones, so it is a harder test than
the run's own mix, in which a judge that always gives 5 is often right.
"""

from __future__ import annotations

import argparse
import asyncio
import time
from dataclasses import dataclass
from itertools import chain, zip_longest
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from jobs.config import load_job
from pipeline.metrics.llm_match import MARK_MAX, MARK_MIN
from pipeline.models.caller import Caller
from pipeline.models.clients import make_caller
from pipeline.models.config import ModelConfig
from pipeline.tasks.marks import mark_answers
from schemas.calls import CallRow
from schemas.questions import Question
from schemas.run_folder import RunFolder, read_table

MARKS = range(MARK_MIN, MARK_MAX + 1)


@dataclass(frozen=True, slots=True)
class Item:
    """An answer that the run's judge marked."""

    question: Question
    """With its reference answer."""
    answer: str
    """What was marked."""
    mark: int
    """By the run's judge, 1 to 5."""


@dataclass(frozen=True, slots=True)
class Marked:
    """What the other judge made of an item."""

    mark: int | None
    """1 to 5; None when no reply could be read."""
    asks: int
    """Requests it took, failed ones among them."""
    prompt_tokens: int
    """Over all of them, by the server's count."""
    seconds: float
    """From the first request to the mark."""


def draw(run: Path, count: int, rng: np.random.Generator) -> list[Item]:
    """Return items in equal numbers of each mark, as far as there are; those with one accepted answer come first.

    Prompts of one kind in a row begin alike, which spares a local server most of the reading.
    """
    questions = {q.question_id: q for unit in RunFolder(str(run)).units() for q in unit.questions}
    arms = read_table(run, "arms")
    arms = arms[(arms.task == "eqa") & arms.mark.isin(list(MARKS))].drop_duplicates(["question_id", "answer"])
    marked = zip(arms.question_id.tolist(), arms.answer.tolist(), arms.mark.tolist(), strict=True)
    items = [Item(questions[question_id], answer, mark) for question_id, answer, mark in marked]
    shuffled = [items[index] for index in rng.permutation(len(items))]
    by_mark = [[item for item in shuffled if item.mark == mark] for mark in MARKS]
    dealt = [item for item in chain.from_iterable(zip_longest(*by_mark)) if item is not None]
    return sorted(dealt[:count], key=lambda item: bool(item.question.extra_answers))


async def mark_all(items: list[Item], caller: Caller) -> list[Marked]:
    """Have the items marked one after another."""
    found = []
    for item in items:
        calls: list[CallRow] = []
        start = time.perf_counter()
        (mark,) = await mark_answers(item.question, [item.answer], ["again"], caller, calls, None)
        tokens = sum(call.prompt_tokens for call in calls)
        found.append(Marked(mark.mark, len(calls), tokens, time.perf_counter() - start))
        print(
            f"{item.mark} -> {mark.mark or '?'}  {found[-1].seconds:5.1f} s  {item.question.question} | "
            f"{item.question.answer} | {item.answer}",
            flush=True,
        )
    await caller.aclose()
    return found


def kappa(first: np.ndarray, second: np.ndarray) -> float:
    """Return Cohen's kappa of two raters' classes; NaN where chance alone would agree always."""
    expected = sum(np.mean(first == value) * np.mean(second == value) for value in np.union1d(first, second))
    return float((np.mean(first == second) - expected) / (1 - expected)) if expected < 1 else float("nan")


def report(items: list[Item], marked: list[Marked]) -> None:
    """Print the agreement of the two judges."""
    read = [(item.mark, again.mark) for item, again in zip(items, marked, strict=True) if again.mark is not None]
    first, second = np.array(read, dtype=int).reshape(-1, 2).T
    print(
        f"\n{len(items)} items, {len(items) - len(read)} unparsed, "
        f"{sum(again.asks > 1 for again in marked)} asked again"
    )
    seconds = np.array([again.seconds for again in marked])
    print(
        f"seconds an item: mean {seconds.mean():.1f}, median {np.median(seconds):.1f}, most {seconds.max():.1f}; "
        f"prompt tokens {np.mean([again.prompt_tokens for again in marked]):.0f}"
    )
    if len(read) < 2:
        return
    apart = np.abs(first - second)
    bands = [np.digitize(marks, (3, 4)) for marks in (first, second)]
    same, near = np.mean(apart == 0), np.mean(apart <= 1)
    print(f"same mark {same:.0%}, within one {near:.0%}, mean |difference| {apart.mean():.2f}")
    print(f"mean mark {first.mean():.2f} of the run, {second.mean():.2f} of the endpoint")
    print(
        f"Spearman {spearmanr(first, second).statistic:.2f}, kappa of wrong (1, 2), partly (3), right (4, 5) "
        f"{kappa(*bands):.2f}, same band {np.mean(bands[0] == bands[1]):.0%}"
    )
    print("\nrun's mark, then how often the endpoint gave 1 to 5")
    for mark in MARKS:
        print(f"  {mark}:", *(f"{np.sum((first == mark) & (second == given)):3d}" for given in MARKS))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="finished run folder; only read")
    parser.add_argument("job", type=Path, help="job file with the endpoint")
    parser.add_argument("--endpoint", help="its name; the one of the job's judge if not given")
    parser.add_argument("--items", type=int, default=50, help="answers to mark")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    options = parser.parse_args()
    models = load_job(options.job).models
    name = options.endpoint or models.endpoint_of("judge")
    judge = ModelConfig.model_validate(models.model_dump() | {"default": "symbolic", "stages": {"judge": name}})
    items = draw(options.run, options.items, np.random.default_rng(options.seed))
    if not items:
        parser.error(f"{options.run}: holds no marked answer")
    report(items, asyncio.run(mark_all(items, make_caller(judge, None))))


if __name__ == "__main__":
    main()
