"""How near `splatreasoner plan` comes to what a run then takes, by stage.

The apartments of `splatreasoner demo` with their questions are planned from 60 of them, then run whole. The model of
the run answers as the symbolic one does, and bills by a rule of its own: four bytes a token, a fixed number a picture.

    python benchmarks/forecast.py                       # 3 scenes, 330 questions; about five minutes
    python benchmarks/forecast.py --scenes 1 --sample 30
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from jobs.build import build_procedural
from jobs.config import JobConfig
from jobs.demo import SEEDS
from jobs.forecast import forecast
from jobs.submit import submit
from pipeline.models.cache import CallCache
from pipeline.models.caller import Caller
from schemas.run_folder import read_table
from tests.jobs.test_forecast import ENDPOINT, metered_caller
from workers.method_steps import METHOD_STEPS
from workers.steps import Work

ROW_STAGE = {"answer_one": "answer", "answer_many": "answer"}
"""Rows call both answer prompts one stage."""
Sums = dict[str, list[float]]
"""By stage: calls, prompt tokens, completion tokens, US dollars."""


def storing_caller(work: Work, gates: Any) -> Caller:
    """Return the metered caller with a cache, as a run has by default."""
    caller = metered_caller(work, gates)
    caller.cache = CallCache(Path(work.calls))
    return caller


def planned(config: JobConfig, sample: int) -> Sums:
    """Return what the plan says."""
    sums: Sums = {}
    for said in forecast(config, sample=sample).stages:
        stage = sums.setdefault(ROW_STAGE.get(said.stage, said.stage), [0.0] * 4)
        for place, value in enumerate((said.calls, said.prompt_tokens, said.completion_tokens, said.usd or 0.0)):
            stage[place] += value
    return sums


def used(config: JobConfig) -> Sums:
    """Return what the run was billed for: rows that were found in the cache cost nothing."""
    run = submit(config, steps=replace(METHOD_STEPS, make_caller=storing_caller)).run
    calls = read_table(run, "calls")
    paid = calls[~calls["cached"]].groupby("stage")
    columns = ["prompt_tokens", "completion_tokens", "usd"]
    return {str(stage): [float(len(rows)), *map(float, rows[columns].sum())] for stage, rows in paid}


def show(said: Sums, billed: Sums) -> None:
    """Print a table in Markdown: planned, used, planned / used."""
    print("| stage | calls | tokens in | tokens out | usd |\n|---|---|---|---|---|")
    for stage in [*said, *(stage for stage in billed if stage not in said), "all"]:
        pair = [_of(sums, stage) for sums in (said, billed)]
        cells = [_cell(plan, use, money=place == 3) for place, (plan, use) in enumerate(zip(*pair, strict=True))]
        print(f"| {stage} | " + " | ".join(cells) + " |")


def _of(sums: Sums, stage: str) -> list[float]:
    return list(map(sum, zip(*sums.values(), strict=True))) if stage == "all" else sums.get(stage, [0.0] * 4)


def _cell(plan: float, use: float, *, money: bool) -> str:
    form = ",.2f" if money else ",.0f"
    return f"{plan:{form}} / {use:{form}} = {plan / use:.2f}" if use else f"{plan:{form}} / 0"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--scenes", type=int, default=3)
    options.add_argument("--sample", type=int, default=60, help="questions the plan tries")
    given = options.parse_args()
    os.environ[str(ENDPOINT["key_env"])] = "nothing is sent"
    with tempfile.TemporaryDirectory(prefix="forecast-") as folder:
        place = partial(os.path.join, folder)
        scenes = [build_procedural(seed, place(f"apartment-{seed}")) for seed in SEEDS[: given.scenes]]
        config = JobConfig.model_validate(
            {
                "name": "forecast",
                "output": place("run"),
                "scenes": [scene.uri for scene in scenes],
                "images": False,
                "models": {"endpoints": {"e": ENDPOINT}, "default": "e"},
                "workers": {"in_process": True},
            }
        )
        print(
            f"{given.scenes} scenes, {sum(scene.questions for scene in scenes)} questions, {given.sample} tried",
            flush=True,
        )
        said = planned(config, given.sample)
        show(said, used(config))


if __name__ == "__main__":
    main()
