"""What the page loads at once: every question in a line, the maps of the scenes, and the prompts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from jobs.report.pictures import Pictures
from jobs.report.questions import LABELS
from pipeline.models.prompts import BUILT_IN, Prompts

SHARD = 50
"""Questions a file: about half a megabyte, loaded when the first of them is opened."""


def list_data(
    listed: Sequence[Mapping[str, Any]], drawn: Pictures, prompts: Sequence[Mapping[str, str]]
) -> dict[str, Any]:
    """Return the data named `list`.

    Args:
        listed: From `Questions.listed`.
        drawn: Maps and what was left out.
        prompts: From `prompt_templates`.
    """
    scenes, tasks, categories = (sorted({str(row[name]) for row in listed}) for name in ("scene", "task", "category"))
    places = [{name: place for place, name in enumerate(names)} for names in (scenes, tasks, categories)]
    labels = list(LABELS)
    return {
        "shard": SHARD,
        "scenes": scenes,
        "tasks": tasks,
        "categories": categories,
        "labels": [[label, LABELS[label]] for label in labels],
        "maps": [drawn.maps.get(scene) for scene in scenes],
        "problems": [drawn.problems.get(scene, "") for scene in scenes],
        "note": drawn.note,
        "prompts": list(prompts),
        "rows": [
            [
                row["id"],
                row["question"],
                row["answer"],
                row["reference"],
                *(place[str(row[name])] for place, name in zip(places, ("scene", "task", "category"), strict=True)),
                sum(1 << labels.index(label) for label in row["labels"]),
                row["scores"],
                int(row["id"] in drawn.questions),
            ]
            for row in listed
        ],
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
