"""Calls a second through the pool of model actors, and where the CPU time of a call goes.

The server answers at once and runs on the same two cores: what is measured is ours, from client to limits and Ray.
Every call asks something of its own. What the rows say is held against what the server counted; the exit code is 1
where a call or a token is missing, a call failed, or fewer calls a second were made than `--at-least`.

    python benchmarks/model_pool.py                      # 4 actors, with and without the cache
    python benchmarks/model_pool.py --actors 1 2 4 --parts
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from pipeline.models.budget import BudgetConfig
from pipeline.models.caller import Caller
from pipeline.models.clients import make_caller, make_clients
from pipeline.models.config import ModelConfig
from pipeline.models.messages import Message, Request
from pipeline.models.replies import parse_index
from schemas.questions import Question
from tests.models.counting_server import CountingServer
from tests.workers import calling_steps
from workers.limiter import Limiter, gates, local_authorities
from workers.ray_tasks import Models
from workers.steps import Work

CORES = 2
CALLS_A_QUESTION = 20
"""As many as the method makes of one with a few clusters."""
CONCURRENCY = 64
"""Calls under way."""
TEXT = "The chair stands beside the window, to the left of a low table. " * 20
"""About 300 tokens, as the prompts of the text stages have."""


@dataclass(frozen=True, slots=True)
class Counted:
    """What was asked, as one side counts it."""

    calls: int = 0
    """Calls sent."""
    tokens: int = 0
    """Tokens of prompts and replies."""
    bad: int = 0
    """Calls that failed or were answered with something else."""

    def __add__(self, other: Counted) -> Counted:
        return Counted(self.calls + other.calls, self.tokens + other.tokens, self.bad + other.bad)


class TimedModels(Models):
    """A model actor that asks what a question of usual size asks, and says what CPU time it took."""

    async def ask(self, name: str) -> Counted:
        """Ask CALLS_A_QUESTION calls that nobody else asks."""
        asked = await asyncio.gather(*(_ask(self._caller, f"{name} {number}") for number in range(CALLS_A_QUESTION)))
        rows = [row for one in asked for row in one.rows if not row.cached]
        tokens = sum(row.prompt_tokens + row.completion_tokens for row in rows)
        return Counted(len(rows), tokens, sum(row.outcome != "ok" for row in rows))

    async def cpu_s(self) -> float:
        """Return the CPU seconds of this process."""
        return time.process_time()


class TimedLimiter(Limiter):
    """A limiter that says what CPU time it took."""

    async def cpu_s(self) -> float:
        """Return the CPU seconds of this process."""
        return time.process_time()


class Server:
    """The server, in a process of its own."""

    def __init__(self) -> None:
        command = [sys.executable, __file__, "--serve"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.pid, self.url = self._process.pid, self._line().strip()

    def counted(self) -> Counted:
        """Return what came in so far."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return Counted(*json.loads(self._line()))

    def end(self) -> None:
        """End it."""
        self._process.communicate()

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()


def serve() -> None:
    """Be the server; tell what came in whenever a line is read."""
    with CountingServer() as server:
        print(server.base_url, flush=True)
        for _ in sys.stdin:
            print(json.dumps(astuple(Counted(server.sent, server.sent_tokens))), flush=True)


async def _ask(caller: Caller, name: str) -> Any:
    question = Question("q", "s", "eqa", TEXT, answer="0")
    variables = {"question": TEXT, "candidates": [name, "b"]}
    return await caller.ask("verify", variables, (), partial(parse_index, count=2), question=question)


def pool(server: Server, actors: int, calls: int, cache: bool, at_least: float) -> bool:
    """Print what a number of actors does; return whether every call counts and there were enough a second."""
    import ray

    with tempfile.TemporaryDirectory(prefix="model-pool-") as folder:
        work = _work(server.url, folder, cache)
        limiter = ray.remote(num_cpus=0)(TimedLimiter).options(max_concurrency=1000).remote(work)
        remote = ray.remote(num_cpus=0)(TimedModels).options(max_concurrency=64)
        pool = [remote.remote(work, calling_steps.STEPS, limiter, f"m-{number}") for number in range(actors)]
        ray.get([actor.ask.remote(f"warm {number}") for number, actor in enumerate(pool) for _ in range(2)])
        processes, before = [*pool, limiter], server.counted()
        cpu = ray.get([process.cpu_s.remote() for process in processes])
        driver, ours, theirs = time.process_time(), _tree_cpu_s(os.getpid()), _tree_cpu_s(server.pid)
        start = time.perf_counter()
        questions = [pool[n % actors].ask.remote(f"question {n}") for n in range(calls // CALLS_A_QUESTION)]
        asked = sum(ray.get(questions), Counted())
        seconds = time.perf_counter() - start
        theirs = _tree_cpu_s(server.pid) - theirs
        ours, driver = _tree_cpu_s(os.getpid()) - ours - theirs, time.process_time() - driver
        used = [b - a for a, b in zip(cpu, ray.get([process.cpu_s.remote() for process in processes]), strict=True)]
        after = server.counted()
        ray.get([actor.close.remote() for actor in pool])
        for process in processes:
            ray.kill(process)
    came = Counted(after.calls - before.calls, after.tokens - before.tokens)
    parts = {"actors": sum(used[:-1]), "limiter": used[-1], "driver": driver, "Ray": ours - sum(used) - driver}
    told = ", ".join(f"{name} {1e3 * spent / asked.calls:.2f}" for name, spent in parts.items())
    rate, good = asked.calls / seconds, asked == came and asked.calls == len(questions) * CALLS_A_QUESTION
    print(
        f"{actors} actors, cache {'on' if cache else 'off'}: {rate:.0f} calls/s; CPU ms a call: client side "
        f"{1e3 * ours / asked.calls:.2f} ({told}), server {1e3 * theirs / asked.calls:.2f}\n"
        f"  calls asked {asked.calls}, counted by the server {came.calls}; tokens {asked.tokens}, "
        f"counted {came.tokens}; bad {asked.bad}{'' if good else '  WRONG'}{'' if rate >= at_least else '  TOO SLOW'}",
        flush=True,
    )
    return good and rate >= at_least


def _tree_cpu_s(root: int) -> float:
    """Return the CPU seconds of a process and all that stem from it."""
    parent, spent = dict[int, int](), dict[int, float]()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has just ended
        pid = int(path.parent.name)
        parent[pid], spent[pid] = int(fields[1]), (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    mine = {root}
    while more := {pid for pid, above in parent.items() if above in mine} - mine:
        mine |= more
    return sum(spent[pid] for pid in mine)


def parts(url: str, calls: int) -> None:
    """Print the CPU time of a call in one process, part after part."""
    with tempfile.TemporaryDirectory(prefix="model-pool-") as folder:
        work = _work(url, folder, cache=True)
        client = make_clients(work.models)["verify"]

        async def complete(caller: Caller, name: str) -> None:
            await client.complete(Request("verify", (Message("user", (f"{TEXT} {name}",)),)))

        ways: list[tuple[str, Callable[..., Any], Callable[[], Caller]]] = [
            ("client alone", complete, lambda: make_caller(work.models, None)),
            ("caller", _ask, lambda: make_caller(work.models, None)),
            ("caller and gate", _ask, lambda: make_caller(work.models, None, gates(local_authorities(work)))),
            (
                "all with cache",
                _ask,
                lambda: make_caller(work.models, Path(work.calls), gates(local_authorities(work))),
            ),
        ]

        async def timed(caller: Caller, ask: Callable[..., Any], name: str) -> tuple[float, float]:
            spent = await _timed(caller, ask, name, calls)
            if ask is complete:
                await client.aclose()
            return spent

        for name, ask, make in ways:
            wall, cpu = asyncio.run(timed(make(), ask, name))
            print(f"{name:16s} {calls / wall:5.0f} calls/s, {1e3 * cpu / calls:.2f} ms CPU a call", flush=True)


async def _timed(caller: Caller, ask: Callable[..., Any], name: str, calls: int) -> tuple[float, float]:
    turns = asyncio.Semaphore(CONCURRENCY)

    async def one(number: int) -> None:
        async with turns:
            await ask(caller, f"{name} {number}")

    await asyncio.gather(*(one(-number) for number in range(1, 100)))
    wall, cpu = time.perf_counter(), time.process_time()
    await asyncio.gather(*(one(number) for number in range(calls)))
    spent = time.perf_counter() - wall, time.process_time() - cpu
    await caller.aclose()
    return spent


def _work(url: str, folder: str, cache: bool) -> Work:
    endpoint = {"kind": "openai", "base_url": url, "model": "m", "max_tokens": 50, "concurrency": CONCURRENCY}
    models = ModelConfig.model_validate({"endpoints": {"e": endpoint}, "default": "e"})
    return Work(
        None,
        models,
        str(Path(folder, "calls")),
        "",
        "",
        "on" if cache else "off",
        BudgetConfig(),
        str(Path(folder, "journals")),
        uuid.uuid4().hex,
    )


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--calls", type=int, default=6000, help="calls of each measurement")
    options.add_argument("--actors", type=int, nargs="*", default=[4], help="numbers of actors")
    options.add_argument("--at-least", type=float, default=500.0, help="calls a second that every pool is to make")
    options.add_argument("--parts", action="store_true", help="also measure a call part after part in one process")
    options.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.serve:
        serve()
        return
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
    server = Server()
    if given.parts:
        parts(server.url, given.calls // 2)
    good = True
    if given.actors:
        from workers.ray_session import ray_session

        with ray_session(cpus=CORES):
            for cache in (True, False):
                for actors in given.actors:
                    good &= pool(server, actors, given.calls, cache, given.at_least)
    server.end()
    sys.exit(not good)


if __name__ == "__main__":
    main()
