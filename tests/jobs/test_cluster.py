"""Runs on a cluster of two nodes that are processes of this machine, one of which dies."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from jobs.runs.submit import submit
from schemas.run_folder import read_table
from tests.conftest import ROOT
from tests.jobs.chaos.measured import Measured
from tests.jobs.conftest import MakeJob
from tests.jobs.faults import driver, ended, job_file, result_bytes, wait_for_commits
from tests.workers.fake_steps import STEPS
from workers.ray_session import QUIET

pytestmark = [
    pytest.mark.slow,
    # Ray leaves the sockets and pipes of its own processes to the garbage collector.
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]

TEXTS = ["slow a", "slow no evidence", "slow b", "slow cc"] * 15


@pytest.fixture
def cluster(make_job: MakeJob, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A cluster whose head offers one CPU; its workers find the fake steps and where faults leave their marks."""
    for name, value in {**QUIET, "PYTHONPATH": str(ROOT)}.items():
        monkeypatch.setenv(name, value)
    from ray.cluster_utils import Cluster

    started = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    try:
        yield started
    finally:
        started.shutdown()


@pytest.mark.chaos("node loss")
def test_run_whose_node_dies_ends_with_the_rows_of_an_undisturbed_one(
    cluster: Any, make_scene: Callable[..., Path], make_job: MakeJob, tmp_path: Path, measured: Measured
) -> None:
    make_scene("a", TEXTS)
    make_scene("b", TEXTS)
    whole = submit(make_job("whole"), steps=STEPS)
    node = cluster.add_node(num_cpus=2)
    job = make_job("shared", workers={"in_process": False, "address": cluster.address})
    with driver("submit", job_file(job, tmp_path)) as process:
        wait_for_commits(job.output, 5, process)
        cluster.remove_node(node, allow_graceful=False)
        measured.struck()
        code, said = ended(process)
        measured.ended(code)
    assert code == 0, said
    measured.compare(job.output, whole.run)
    assert result_bytes(job.output) == result_bytes(whole.run)
    assert read_table(job.output, "answers")["question_id"].is_unique
    assert "Traceback" not in said, "at most a line of Ray's own on what it lost"
