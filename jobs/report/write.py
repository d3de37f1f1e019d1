"""From a run folder to report.html and the folder of its data."""

from __future__ import annotations

from pathlib import Path

from jobs.report.listing import in_files, list_data, prompt_templates, scenery
from jobs.report.page import RunFacts, page
from jobs.report.pictures import DrawingBudget, draw_pictures
from jobs.report.questions import LABELS, OF_A_QUESTION, Lines, Questions
from jobs.report.shards import DataFolder
from jobs.runs.events import read_events
from jobs.runs.progress import Progress, Silent
from jobs.runs.status import run_status
from jobs.scoring.aggregate import aggregate_tables, read_needed
from jobs.scoring.scores import Options
from schemas import storage
from schemas.run_folder import RunFolder, read_table
from schemas.run_rows import RunRows

REPORT = "report.html"
DATA = "report"
"""Folder beside the page."""
MAX_QUESTIONS = 20_000
"""Questions in the list, which is loaded whole: 0.15 KB each and more with long texts."""


def write_report(
    run: str | Path,
    *,
    options: Options | None = None,
    max_questions: int = MAX_QUESTIONS,
    drawing: DrawingBudget | None = None,
    progress: Progress | None = None,
    writing: Progress | None = None,
) -> str:
    """Write the page of a run and return its path or URI.

    It is made from the run folder, needs no network, and shows the thumbnails that lie beside it. Overlays and maps
    are drawn for some questions where the scenes' files are at hand.

    Args:
        run: Run folder, a path or URI.
        options: How metrics are computed.
        max_questions: Questions shown one by one, in plan order; the tables count all.
        drawing: How many questions get pictures from their scene.
        progress: Who is told how drawing goes; None for nobody.
        writing: Who is told how reading and writing go; None for nobody.

    Raises:
        InputError: There is no such run, or a part is damaged.
    """
    folder, told = RunFolder(str(run)), writing or Silent()
    facts = RunFacts(folder.read_run(), run_status(folder.root), tuple(read_events(folder.root)))
    told.say("reading the tables")
    tables = read_needed(folder.root)
    tables |= {name: read_table(folder.root, name) for name in OF_A_QUESTION if name not in tables}
    images = {f"images/{name}" for name in storage.list_files(folder.uri("images"), recursive=True)}
    told.say("computing the scores")
    metrics = aggregate_tables(tables, options)
    questions = Questions(tables, RunRows(folder.root), images, max_questions)
    data, listed = DataFolder(folder.uri(DATA), DATA), questions.listed()
    config = facts.run.get("config")
    method = config.get("method", {}) if isinstance(config, dict) else {}
    drawn = draw_pictures(folder.root, method, questions, listed, data, drawing or DrawingBudget(), progress)
    for file, ids in in_files(questions.ids, told):
        lines = Lines()
        records = questions.records(ids, lines)
        shown = [{**record, "drawn": drawn.questions.get(key)} for key, record in records.items()]
        data.script(file, {"records": shown, "lines": lines.all()})
    more = {"scenery": scenery(drawn), "prompts": prompt_templates(facts.run)}
    data.script("list", list_data(listed, LABELS, drawn.questions, **more))
    data.tidy()
    content = page(facts, metrics, tables, shown=len(questions), data=DATA)
    uri = folder.uri(REPORT)
    storage.write_bytes_atomic(uri, content.encode("utf-8", "replace"))
    return uri
