"""Calls a second through the pool of model actors, and where the CPU time of a call goes.

The server answers at once and runs on the same machine: what is measured is ours, from client to limits and Ray.

    python benchmarks/model_pool.py                 # 1, 2 and 4 actors, with and without the cache
    python benchmarks/model_pool.py --calls 2000 --actors 2
"""

from __future__ import annotations

import argparse
import asyncio
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable
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

CALLS_A_QUESTION = 20
"""As many as the method makes of one with a few clusters."""
CONCURRENCY = 32
"""Calls under way: a server that answers at once needs no more, and idle connections cost time at each call."""
TEXT = "The chair stands beside the window, to the left of a low table. " * 20
"""About 300 tokens, as the prompts of the text stages have."""


class TimedModels(Models):
    """A model actor that asks what a question of usual size asks, and says what CPU time it took."""

    async def ask(self, name: str) -> int:
        """Ask CALLS_A_QUESTION calls that nobody else asks; return how many were sent."""
        asked = await asyncio.gather(*(_ask(self._caller, f"{name} {number}") for number in range(CALLS_A_QUESTION)))
        return sum(not row.cached for one in asked for row in one.rows)

    async def cpu_s(self) -> float:
        """Return the CPU seconds of this process."""
        return time.process_time()


class TimedLimiter(Limiter):
    """A limiter that says what CPU time it took."""

    async def cpu_s(self) -> float:
        """Return the CPU seconds of this process."""
        return time.process_time()


async def _ask(caller: Caller, name: str) -> Any:
    question = Question("q", "s", "eqa", TEXT, answer="0")
    variables = {"question": TEXT, "candidates": [name, "b"]}
    return await caller.ask("verify", variables, (), partial(parse_index, count=2), question=question)


def pool(url: str, actors: int, calls: int, cache: bool) -> None:
    """Print calls a second and CPU time a call of a number of actors."""
    import ray

    with tempfile.TemporaryDirectory(prefix="model-pool-") as folder:
        work = _work(url, folder, cache)
        limiter = ray.remote(num_cpus=0)(TimedLimiter).options(max_concurrency=1000).remote(work)
        remote = ray.remote(num_cpus=0)(TimedModels).options(max_concurrency=64)
        pool = [remote.remote(work, calling_steps.STEPS, limiter, f"m-{number}") for number in range(actors)]
        ray.get([actor.ask.remote(f"warm {number}") for number, actor in enumerate(pool)])
        processes = [*pool, limiter]
        before = ray.get([process.cpu_s.remote() for process in processes])
        start, driver = time.perf_counter(), time.process_time()
        questions = [pool[n % actors].ask.remote(f"question {n}") for n in range(calls // CALLS_A_QUESTION)]
        sent = sum(ray.get(questions))
        seconds, driver = time.perf_counter() - start, time.process_time() - driver
        used = [b - a for a, b in zip(before, ray.get([process.cpu_s.remote() for process in processes]), strict=True)]
        print(
            f"{actors} actors, cache {'on ' if cache else 'off'}: {sent / seconds:5.0f} calls/s; CPU ms a call: "
            f"actors {1e3 * sum(used[:-1]) / sent:.2f}, limiter {1e3 * used[-1] / sent:.2f}, "
            f"driver {1e3 * driver / sent:.2f}",
            flush=True,
        )
        for process in processes:
            ray.kill(process)


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
        for name, ask, make in ways:
            wall, cpu = asyncio.run(_timed(make(), ask, name, calls))
            print(f"{name:16s} {calls / wall:5.0f} calls/s, {1e3 * cpu / calls:.2f} ms CPU a call", flush=True)


async def _timed(caller: Caller, ask: Callable[..., Any], name: str, calls: int) -> tuple[float, float]:
    await asyncio.gather(*(ask(caller, f"{name} warm {number}") for number in range(50)))
    wall, cpu = time.perf_counter(), time.process_time()
    await asyncio.gather(*(ask(caller, f"{name} {number}") for number in range(calls)))
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


def serve() -> None:
    """Be the server, until the input ends; then say what CPU time it took."""
    with CountingServer() as server:
        print(server.base_url, flush=True)
        sys.stdin.read()
        print(f"server: {1e3 * time.process_time() / max(1, server.sent):.2f} ms CPU a call, start included")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--calls", type=int, default=4000, help="calls of each measurement")
    options.add_argument("--actors", type=int, nargs="*", default=[1, 2, 4], help="numbers of actors")
    options.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.serve:
        serve()
        return
    command = [sys.executable, __file__, "--serve"]
    server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    url = server.stdout.readline().strip()
    parts(url, given.calls // 2)
    if given.actors:
        from workers.ray_session import ray_session

        with ray_session(cpus=2):
            for cache in (True, False):
                for actors in given.actors:
                    pool(url, actors, given.calls, cache)
    print(server.communicate()[0], end="")


if __name__ == "__main__":
    main()
