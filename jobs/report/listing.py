"""What the page loads at once: every question in a line, the maps of the scenes, and the prompts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from jobs.report.pictures import Pictures
from jobs.runs.progress import Progress
from pipeline.models.prompts import BUILT_IN, Prompts

SHARD = 50
"""Questions a file: about half a megabyte, loaded when the first of them is opened."""


def in_files(ids: Sequence[str], told: Progress) -> Iterator[tuple[str, Sequence[str]]]:
    """Yield the name and the questions of each file of questions, while `told` hears how many are written."""
    told.begin(len(ids), 0)
    try:
        for number, first in enumerate(range(0, len(ids), SHARD)):
            some = ids[first : first + SHARD]
            yield f"q{number}", some
            for _ in some:
                told.advance("")
    finally:
        told.end()


def list_data(
    listed: Sequence[Mapping[str, Any]], labels: Mapping[str, str], drawn: Collection[str], **more: Any
) -> dict[str, Any]:
    """Return the data named `list`.

    Args:
        listed: Rows with the fields of `Questions.listed`.
        labels: Names of the filters, in order.
        drawn: Ids of questions with pictures.
        more: Further data of the page.
    """
    scenes, tasks, categories = (sorted({str(row[name]) for row in listed}) for name in ("scene", "task", "category"))
    places = [{name: place for place, name in enumerate(names)} for names in (scenes, tasks, categories)]
    bits = {label: 1 << place for place, label in enumerate(labels)}
    return {
        "shard": SHARD,
        "scenes": scenes,
        "tasks": tasks,
        "categories": categories,
        "labels": [list(pair) for pair in labels.items()],
        "rows": [
            [
                row["id"],
                row["question"],
                row["answer"],
                row["reference"],
                *(place[str(row[name])] for place, name in zip(places, ("scene", "task", "category"), strict=True)),
                sum(bits[label] for label in row["labels"]),
                row["scores"],
                int(row["id"] in drawn),
            ]
            for row in listed
        ],
        **more,
    }


def scenery(drawn: Pictures) -> dict[str, Any]:
    """Return what the page knows of a run's scenes; scenes are in lists, since a name could be any text."""
    return {
        "maps": [[scene, found] for scene, found in drawn.maps.items()],
        "problems": [[scene, found] for scene, found in drawn.problems.items()],
        "note": drawn.note,
    }


def prompt_templates(run: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return the prompts of a run whose text is known: those of this version that have the hash the run recorded."""
    basis = run.get("basis")
    recorded = basis.get("prompts") if isinstance(basis, Mapping) else None
    if not isinstance(recorded, Mapping):
        return []
    known = Prompts.load().hashes()
    return [
        {"name": name, "sha256": digest, "text": (BUILT_IN / f"{name}.txt").read_text(encoding="utf-8")}
        for name, digest in known.items()
        if recorded.get(name) == digest
    ]
