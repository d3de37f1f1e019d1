"""In-process and Ray give the same rows, and each fault does what the error tree says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from schemas.errors import StopError
from schemas.plan import PlannedUnit
from tests.workers.fake_steps import MARKS, STEPS, unit
from workers.dispatch import Backend, Limits, Outcome, dispatch
from workers.in_process import InProcess
from workers.steps import Work

pytestmark = pytest.mark.filterwarnings(
    # Ray leaves the sockets and pipes of its own processes to the garbage collector.
    "ignore::ResourceWarning",
    "ignore::pytest.PytestUnraisableExceptionWarning",
)

LIMITS = Limits(in_flight=4, timeout_s=60.0, retries=2)


@pytest.fixture(scope="module")
def ray_up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A local Ray for the module, and the folder where its workers leave the marks of faults."""
    from workers.ray_session import ray_session

    marks = tmp_path_factory.mktemp("marks")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(MARKS, str(marks))
        with ray_session(cpus=2):
            yield marks


def answers(outcomes: list[Outcome]) -> dict[str, tuple[str, str, str]]:
    rows = [row for outcome in outcomes for row in outcome.tables["answers"]]
    return {row.question_id: (row.status, row.answer, row.reason) for row in rows}


def on_ray(work: Work, units: list[PlannedUnit], limits: Limits = LIMITS) -> list[Outcome]:
    from workers.ray_backend import OnRay

    backend = OnRay(work, STEPS, model_actors=2, in_flight=limits.in_flight, slots=2)
    try:
        return ended(backend, units, limits)
    finally:
        backend.close()


def in_process(work: Work, units: list[PlannedUnit], limits: Limits = LIMITS) -> list[Outcome]:
    backend = InProcess(work, STEPS)
    try:
        return ended(backend, units, limits)
    finally:
        backend.close()


def ended(backend: Backend[Any], units: list[PlannedUnit], limits: Limits) -> list[Outcome]:
    return list(dispatch(units, backend, limits))


def test_in_process_and_ray_give_the_same_rows(work: Work, ray_up: Path) -> None:
    units = [unit(0, ["a", "bb", "no evidence", "bug"]), unit(1, ["x", "y"], "broken"), unit(2, ["c", "always busy"])]
    here, there = in_process(work, units), on_ray(work, units)
    assert answers(here) == answers(there)
    assert {o.error for o in here} == {"", "QuestionError", "ZeroDivisionError", "InputError", "RetryError"}
    for name in ("arms", "candidates"):
        rows = [
            sorted(repr(row) for outcome in outcomes for row in outcome.tables.get(name, ()))
            for outcomes in (here, there)
        ]
        assert rows[0] == rows[1]


def test_scene_arrays_arrive_in_ray_workers_without_a_copy(work: Work, ray_up: Path) -> None:
    (outcome,) = on_ray(work, [unit(7, ["is it writeable"])])
    assert outcome.tables["answers"][0].answer.startswith("435 read-only")


def test_index_of_a_scene_is_computed_in_parts_and_known_to_every_worker(work: Work, ray_up: Path) -> None:
    found = on_ray(work, [unit(8, ["is it indexed"] * 4)])
    assert {o.tables["answers"][0].answer.split()[1] for o in found} == {"10"}
    once = [row for o in found for row in o.tables["timings"] if row.question_id == ""]
    assert sorted(row.stage for row in once) == ["index", "index", "load"]
    assert {row.scene for row in once} == {"scene8"}
    assert sum(row.count for row in once if row.stage == "index") == 10


def test_killed_worker_costs_its_question_a_retry_and_nothing_else(work: Work, ray_up: Path) -> None:
    found = on_ray(work, [unit(3, ["a", "kill the worker", "b"])])
    assert {status for status, _, _ in answers(found).values()} == {"answered"}
    tries = {o.position: o.tries for o in found}
    assert tries[1] >= 2


def test_question_that_always_kills_its_worker_fails_alone(work: Work, ray_up: Path) -> None:
    limits = Limits(in_flight=1, timeout_s=60.0, retries=1)
    found = on_ray(work, [unit(4, ["a", "always kills", "b"])], limits)
    assert [(o.position, o.error, o.tries) for o in found if o.error] == [(1, "WorkerLostError", 2)]


def test_question_that_hangs_in_a_worker_is_killed_and_tried_again(work: Work, ray_up: Path) -> None:
    limits = Limits(in_flight=2, timeout_s=6.0, retries=1)
    found = on_ray(work, [unit(5, ["hangs", "a"])], limits)
    assert answers(found)["scene5-0"][0] == "answered"
    assert {o.position: o.tries for o in found}[0] == 2


@pytest.mark.parametrize("where", ["in_process", "on_ray"])
def test_stop_error_of_a_model_ends_the_run(work: Work, ray_up: Path, where: str) -> None:
    with pytest.raises(StopError, match="the key was refused"):
        {"in_process": in_process, "on_ray": on_ray}[where](work, [unit(6, ["a", "stop", "b"])])


def test_thumbnails_are_written_once_a_candidate(work: Work, tmp_path: Path) -> None:
    in_process(work, [unit(0, ["a", "b", "c"])])
    (picture,) = (tmp_path / "run" / "images").rglob("*.jpg")
    assert picture.parent.name == "scene0"
    from PIL import Image

    with Image.open(picture) as image:
        assert image.size == (256, 192)
