from __future__ import annotations

import asyncio
import dataclasses
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from schemas.errors import StopError
from tests.workers import fake_steps
from tests.workers.fake_steps import STEPS, unit
from workers.dispatch import Limits, dispatch
from workers.ray_session import PACKAGES, ROOT, WORKER_ENVIRONMENT, Cluster, ray_session
from workers.steps import Work

pytestmark = pytest.mark.filterwarnings(
    # Ray leaves the sockets and pipes of its own processes to the garbage collector.
    "ignore::ResourceWarning",
    "ignore::pytest.PytestUnraisableExceptionWarning",
)

QUESTIONS = 40
MODEL_S = 3.0


@pytest.fixture(scope="module")
def one_slot() -> Iterator[Cluster]:
    """A local Ray with one CPU slot, on a machine where another cluster seems to run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_ADDRESS", "")
        with ray_session(cpus=1) as cluster:
            yield cluster


async def slow_decide(*arguments: Any) -> Any:
    await asyncio.sleep(MODEL_S)
    return await fake_steps.decide(*arguments)


def test_local_ray_offers_the_slots_asked_for_and_its_head_answers(one_slot: Cluster) -> None:
    assert one_slot.slots == 1
    time.sleep(2.5)
    one_slot.head.check()
    assert one_slot.head._silent_s < 2.5


def test_thread_settings_hold_on_workers(one_slot: Cluster) -> None:
    import ray

    def threads() -> tuple[dict[str, str | None], int]:
        import numba

        return {name: os.environ.get(name) for name in WORKER_ENVIRONMENT}, numba.get_num_threads()

    found, count = ray.get(ray.remote(num_cpus=1)(threads).remote(), timeout=60)
    assert found == WORKER_ENVIRONMENT
    assert count == 1


def test_questions_that_wait_for_a_model_hold_no_slot(one_slot: Cluster, work: Work) -> None:
    from workers.ray_backend import OnRay

    steps = dataclasses.replace(STEPS, decide=slow_decide)
    backend = OnRay(work, steps, model_actors=1, in_flight=QUESTIONS, slots=1)
    limits = Limits(QUESTIONS, 120.0, 0, batch=1)
    before = time.monotonic()
    try:
        outcomes = list(dispatch([unit(0, ["a"] * QUESTIONS)], backend, limits))
    finally:
        backend.close()
    took_s = time.monotonic() - before
    assert {outcome.error for outcome in outcomes} == {""}
    assert len(outcomes) == QUESTIONS
    assert took_s < QUESTIONS * MODEL_S / 3, "one slot serves all questions while their models are asked"


def test_address_where_nobody_listens_stops_at_once() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with (
        pytest.raises(StopError, match=f"no Ray cluster answers at 127.0.0.1:{port}"),
        ray_session(cpus=1, address=f"127.0.0.1:{port}"),
    ):
        pytest.fail("there is no cluster")


def test_ray_that_does_not_start_is_told_in_one_line_with_the_way_around(monkeypatch: pytest.MonkeyPatch) -> None:
    import ray

    def slow(**_: object) -> None:
        raise Exception("The current node timed out during startup.\nMore.")

    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr(ray, "init", slow)
    with pytest.raises(StopError, match=r"timed out during startup\. \(--in-process does"), ray_session(cpus=1):
        pytest.fail("there is no cluster")


@pytest.mark.parametrize(
    ("given", "variable", "asked"), [("", "", "local"), ("", "head:6379", "head:6379"), ("auto", "x:1", "auto")]
)
def test_cluster_is_the_one_named_or_that_of_the_submitted_job_and_else_a_new_one(
    monkeypatch: pytest.MonkeyPatch, given: str, variable: str, asked: str
) -> None:
    import ray

    def init(**options: Any) -> None:
        assert options["address"] == asked
        raise ConnectionError("enough")

    monkeypatch.setattr(ray, "init", init)
    monkeypatch.setattr("workers.ray_session._reach", lambda address: None)
    monkeypatch.setenv("RAY_ADDRESS", variable)
    with pytest.raises((StopError, ConnectionError)), ray_session(cpus=1, address=given):
        pytest.fail("it did not start")


def test_packages_that_travel_to_a_cluster_are_there() -> None:
    assert all((ROOT / name / "__init__.py").is_file() for name in PACKAGES)


def test_kubernetes_manifest_has_the_fields_that_the_operator_reads() -> None:
    found = yaml.safe_load(Path(ROOT, "docs", "rayjob.yaml").read_text())
    assert (found["apiVersion"], found["kind"]) == ("ray.io/v1", "RayJob")
    spec = found["spec"]
    assert spec["entrypoint"].startswith("splatreasoner submit ")
    assert spec["backoffLimit"] > 0, "a run that lost its cluster goes on"
    cluster = spec["rayClusterSpec"]
    (workers,) = cluster["workerGroupSpecs"]
    pods = [group["template"]["spec"] for group in (cluster["headGroupSpec"], workers)]
    for pod in pods:
        (container,) = pod["containers"]
        mounted = {mount["name"] for mount in container["volumeMounts"]}
        assert mounted == {volume["name"] for volume in pod["volumes"]}
        assert {variable["name"]: variable["value"] for variable in container["env"]}["NUMBA_NUM_THREADS"] == "1"
        assert container["resources"]["limits"] == container["resources"]["requests"]
    assert cluster["headGroupSpec"]["rayStartParams"]["num-cpus"] == "0"
    assert workers["minReplicas"] <= workers["replicas"] <= workers["maxReplicas"]
