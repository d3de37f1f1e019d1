"""From a run folder to report.html."""

from __future__ import annotations

from pathlib import Path

from jobs.aggregate import NEEDED, aggregate_tables
from jobs.coverage import read_plan
from jobs.report.page import RunFacts, page
from jobs.report.questions import question_records
from jobs.scores import Options
from jobs.status import run_status
from schemas import storage
from schemas.run_folder import RunFolder, read_table

REPORT = "report.html"
MAX_QUESTIONS = 2_000
"""Questions shown one by one: about 10 KB each, so that a phone still opens the page."""


def write_report(run: str | Path, *, options: Options | None = None, max_questions: int = MAX_QUESTIONS) -> str:
    """Write the page of a run and return its path or URI.

    It is made from the run folder alone, needs no network, and shows the thumbnails that lie beside it.

    Args:
        run: Run folder, a path or URI.
        options: How metrics are computed.
        max_questions: Questions shown one by one, in plan order; the tables count all.

    Raises:
        InputError: There is no such run, or a part is damaged.
    """
    folder = RunFolder(str(run))
    facts = RunFacts(folder.read_run(), run_status(folder.root))
    tables = {name: read_table(folder.root, name) for name in (*NEEDED, "clusters", "candidates")}
    images = {f"images/{name}" for name in storage.list_files(folder.uri("images"), recursive=True)}
    metrics = aggregate_tables({**tables, "plan": read_plan(folder.root)}, options)
    questions = question_records(tables, images, max_questions)
    content = page(facts, metrics, questions, total=len(tables["answers"]))
    uri = folder.uri(REPORT)
    storage.write_bytes_atomic(uri, content.encode("utf-8", "replace"))
    return uri
