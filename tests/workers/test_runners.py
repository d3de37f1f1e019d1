"""In-process and Ray give the same rows, and each fault does what the error tree says."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from schemas.errors import StopError
from schemas.plan import PlannedUnit
from tests.workers.fake_steps import MARKS, STEPS, unit
from workers.dispatch import Limits, Outcome, dispatch
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


def silent(kind: str, **details: Any) -> None:
    """Note nothing."""


def on_ray(
    work: Work, units: list[PlannedUnit], limits: Limits = LIMITS, note: Callable[..., None] = silent
) -> list[Outcome]:
    from workers.ray_backend import OnRay

    backend = OnRay(work, STEPS, model_actors=2, in_flight=limits.in_flight, slots=2, note=note)
    try:
        return list(dispatch(units, backend, limits, note=note))
    finally:
        backend.close()


def in_process(
    work: Work, units: list[PlannedUnit], limits: Limits = LIMITS, note: Callable[..., None] = silent
) -> list[Outcome]:
    backend = InProcess(work, STEPS, note)
    try:
        return list(dispatch(units, backend, limits, note=note))
    finally:
        backend.close()


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


def counts_once(outcomes: list[Outcome], scene: str) -> dict[str, int]:
    """Items handled by the work done once a scene, by stage."""
    once = [row for outcome in outcomes for row in outcome.tables["timings"] if row.question_id == ""]
    assert {row.scene for row in once} == {scene}
    return {stage: sum(row.count for row in once if row.stage == stage) for stage in {row.stage for row in once}}


def test_index_of_a_scene_is_computed_in_parts_and_known_to_every_worker(work: Work, ray_up: Path) -> None:
    found = on_ray(work, [unit(8, ["is it indexed"] * 4)])
    assert {o.tables["answers"][0].answer.split()[1] for o in found} == {"10"}
    assert counts_once(found, "scene8") == {"load": 1, "prepare": 1, "index_read": 0, "index": 10, "index_join": 10}


def test_index_on_disk_is_not_rendered_again_by_another_runner(work: Work, ray_up: Path) -> None:
    on_ray(work, [unit(9, ["a"])])
    damaged = Path(work.visibility, "scene9", "4")
    damaged.write_text("x")
    told: list[tuple[str, dict[str, Any]]] = []
    again = on_ray(work, [unit(9, ["is it indexed"])], note=lambda kind, **details: told.append((kind, details)))
    assert again[0].tables["answers"][0].answer.split()[1] == "10"
    assert counts_once(again, "scene9") == {"load": 1, "prepare": 1, "index_read": 9, "index": 1, "index_join": 10}
    assert told == [("damaged", {"scene": "scene9", "message": f"{damaged}: expected nothing"})]
    assert counts_once(in_process(work, [unit(9, ["a"])]), "scene9") == {"load": 1, "index_read": 10}


def test_one_process_stores_what_its_questions_had_rendered_and_reads_it_again(work: Work) -> None:
    first = in_process(work, [unit(10, ["a", "bb", "cc", "eeee"])])
    assert counts_once(first, "scene10") == {"load": 1, "index_read": 0}
    assert sorted(path.name for path in Path(work.visibility, "scene10").iterdir()) == ["1", "2", "4"]
    Path(work.visibility, "scene10", "2").write_text("x")
    told: list[str] = []
    again = in_process(work, [unit(10, ["a"])], note=lambda kind, **details: told.append(kind))
    assert counts_once(again, "scene10") == {"load": 1, "index_read": 2}
    assert told == ["damaged"]


@pytest.mark.parametrize("where", ["in_process", "on_ray"])
def test_rows_are_the_same_whatever_travels_together(work: Work, ray_up: Path, where: str) -> None:
    texts = ["a", "bb", "no evidence", "bug", "ccc", "always busy", "x", "dd"]
    runner = {"in_process": in_process, "on_ray": on_ray}[where]
    found = [
        runner(
            dataclasses.replace(work, visibility=f"{work.visibility}-{batch}"),
            [unit(20, texts), unit(21, texts)],
            Limits(in_flight=16, timeout_s=60.0, retries=0, batch=batch),
        )
        for batch in (1, 8)
    ]
    rows = [
        {(o.unit.id, o.position): (o.error, {**o.tables, "timings": None}, o.tries) for o in outcomes}
        for outcomes in found
    ]
    assert rows[0] == rows[1]
    assert len(rows[0]) == 16


def test_worker_killed_by_one_question_of_a_batch_fails_that_one_alone(work: Work, ray_up: Path) -> None:
    limits = Limits(in_flight=5, timeout_s=60.0, retries=0, batch=5)
    told: dict[str, dict[str, Any]] = {}

    def note(kind: str, **details: Any) -> None:
        told[details["error"]] = details

    found = on_ray(work, [unit(22, ["a", "b", "always kills", "bug", "c"])], limits, note)
    assert {o.position: (o.error, o.tries) for o in found} == {
        0: ("", 2),
        1: ("", 2),
        2: ("WorkerLostError", 2),
        3: ("ZeroDivisionError", 2),
        4: ("", 2),
    }
    assert 'raise ZeroDivisionError("division by zero")' in told["ZeroDivisionError"]["traceback"]


def test_bytes_of_pictures_in_flight_are_measured(work: Work, ray_up: Path) -> None:
    from workers.ray_backend import OnRay

    planned = unit(24, ["a", "b", "no evidence"])
    backend = OnRay(work, STEPS, model_actors=1, in_flight=2, slots=1)
    try:
        handle = backend.submit(planned, planned.questions)
        backend.wait([handle], 60.0)
        ended = backend.result(handle)
    finally:
        backend.close()
    picture = 300 * 400 * 3
    # Equal pictures of a batch are one object, but these are two arrays; the failed question holds none.
    assert 2 * picture < ended.held < 2 * picture + 20_000
    assert ended.seconds > 0


def test_killed_worker_costs_its_question_a_retry_and_nothing_else(work: Work, ray_up: Path) -> None:
    found = on_ray(work, [unit(3, ["a", "kill the worker", "b"])])
    assert {status for status, _, _ in answers(found).values()} == {"answered"}
    tries = {o.position: o.tries for o in found}
    assert tries[1] >= 2


def test_question_that_hangs_in_a_worker_is_killed_and_tried_again(work: Work, ray_up: Path) -> None:
    # On a busy machine a process takes seconds to start, so the try after the one that hangs may be late as well.
    limits = Limits(in_flight=2, timeout_s=8.0, retries=5)
    found = on_ray(work, [unit(5, ["hangs", "a"])], limits)
    assert answers(found)["scene5-0"][0] == "answered"
    assert {o.position: o.tries for o in found}[0] >= 2


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
