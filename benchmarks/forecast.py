"""How near `splatreasoner plan` comes to what a run then takes of a server with OpenAI's chat API, by stage.

The apartments of `splatreasoner demo` with their questions are planned, then run whole. The server answers as the
symbolic model does, after a fixed time, and bills by its own count: words and pieces of words, 255 tokens a picture
of up to 512 pixels. Its bill is what is compared, and the seconds of the run. Exit code 1 if a sum is off by more than
15 %, or a stage that makes up 5 % of the bill.

    python -m benchmarks.forecast                       # 3 scenes, 330 questions; about ten minutes on two cores
    python -m benchmarks.forecast --scenes 1 --sample 30
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from jobs.config import JobConfig
from jobs.demo import SEEDS
from jobs.forecast import OF_THE_BILL, Forecast, forecast
from jobs.runs.submit import submit
from jobs.scenes.build import build_procedural
from tests.jobs.metered_server import METERED_STEPS, MeteredServer, metered_endpoint

SHARE = 0.15
"""What a plan may be off by."""
COLUMNS = ("calls", "tokens in", "tokens out", "usd")


def shares(said: Forecast, bill: dict[str, list[float]]) -> float:
    """Print planned, used and their ratio as a table in Markdown; return the worst ratio's distance from one."""
    planned = {s.stage: [s.calls, s.prompt_tokens, s.completion_tokens, s.usd or 0.0] for s in said.stages}
    margins = {s.stage: s.margin for s in said.stages} | {"all": said.margin}
    spent = sum(used[-1] for used in bill.values())
    print(f"| stage | of the bill | {' | '.join(COLUMNS)} | margin said |\n|{'---|' * 7}")
    worst = 0.0
    for stage in [*dict.fromkeys([*planned, *bill]), "all"]:
        plan, used = (_of(sums, stage) for sums in (planned, bill))
        cells = [_cell(*pair, money=place == 3) for place, pair in enumerate(zip(plan, used, strict=True))]
        share = used[-1] / spent
        print(f"| {stage} | {share:.1%} | {' | '.join(cells)} | {margins.get(stage, 0.0):.0%} |")
        if stage == "all":
            worst = max(worst, *(abs(said / real - 1) for said, real in zip(plan, used, strict=True)))
        elif share > OF_THE_BILL:
            worst = max(worst, abs(plan[-1] / used[-1] - 1))
    return worst


def _of(sums: dict[str, list[float]], stage: str) -> list[float]:
    if stage == "all":
        return list(map(sum, zip(*sums.values(), strict=True)))
    return sums.get(stage, [0.0] * len(COLUMNS))


def _cell(plan: float, use: float, *, money: bool) -> str:
    form = ",.3f" if money else ",.0f"
    return f"{plan:{form}} / {use:{form}} = {plan / use:.2f}" if use else f"{plan:{form}} / 0"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--scenes", type=int, default=3)
    options.add_argument("--sample", type=int, help="questions the plan tries; as `plan` decides if left out")
    options.add_argument("--latency", type=float, default=1.0, help="seconds until the server replies")
    options.add_argument("--in-process", action="store_true", help="run without Ray")
    given = options.parse_args()
    cpus = 1 if given.in_process else len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory(prefix="forecast-") as folder, MeteredServer(given.latency) as server:
        scenes = [build_procedural(seed, str(Path(folder, f"apartment-{seed}"))) for seed in SEEDS[: given.scenes]]
        config = JobConfig.model_validate(
            {
                "name": "forecast",
                "output": str(Path(folder, "run")),
                "scenes": [scene.uri for scene in scenes],
                "images": False,
                "models": {"endpoints": {"e": metered_endpoint(server)}, "default": "e"},
                "workers": {"in_process": given.in_process},
            }
        )
        start = time.perf_counter()
        said = forecast(config, sample=given.sample, cpus=cpus, seconds_a_call=given.latency)
        planned_s = time.perf_counter() - start
        assert not server.bill, "a plan asks nobody"
        print(
            f"{given.scenes} scenes, {said.questions} questions; {said.sampled} tried in {planned_s:.0f} s", flush=True
        )
        start = time.perf_counter()
        submit(config, steps=METERED_STEPS)
        used_s = time.perf_counter() - start
        bill = server.priced()
    worst = max(shares(said, bill), abs(said.seconds / used_s - 1))
    print(f"seconds: {said.seconds:.0f} / {used_s:.0f} = {said.seconds / used_s:.2f}", end=" ")
    print(f"(CPU {said.cpu_s:.0f}, limits {said.model_s['e']:.0f}, waiting {said.waiting_s:.0f})")
    sys.exit(worst > SHARE)


if __name__ == "__main__":
    main()
