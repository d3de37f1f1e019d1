"""What the page knows of each question: plain data, one dict a question, with the labels that filters use."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from jobs.scoring.arm_order import place_of, standing_arm
from pipeline.metrics.llm_match import match_score
from schemas.run_folder import image_name
from schemas.run_rows import RunRows

RIGHT_MARK = 4
"""Least LLM-Match mark of a right answer: the judge finds at most a detail wrong."""
RIGHT_IOU = 0.1
"""A grounding is right above this IoU: the stricter of the paper's two thresholds."""

REPLY_SHOWN = 4_000
"""Characters of a reply on the page; the tables hold it whole."""
LISTED = 160
"""Characters of a question and of its answers in the list, which is loaded whole."""
OF_A_QUESTION = ("arms", "clusterings", "clusters", "candidates", "regions", "timings")
"""Tables with rows of a question that are read whole, beside `answers`; calls, with their long texts, are not."""

LABELS: Mapping[str, str] = {
    "right": "Right",
    "wrong": "Wrong",
    "unscored": "Not scored",
    "novel": "Changed by novel views",
    "novel-better": "Better by novel views",
    "novel-worse": "Worse by novel views",
    "verify": "Changed by verification",
    "verify-better": "Better by verification",
    "verify-worse": "Worse by verification",
    "failed": "Failed",
    "unparsed": "Unparsed",
    "skipped": "Skipped",
}
"""Filters of the question list, in order."""


class Lines:
    """Lines of text, each kept once: the requests of some questions are mostly the same words."""

    def __init__(self) -> None:
        self._places: dict[str, int] = {}

    def places(self, text: str) -> list[int]:
        """Return the places of a text's lines in `all`; none of an empty text."""
        return [self._places.setdefault(line, len(self._places)) for line in text.split("\n")] if text else []

    def all(self) -> list[str]:
        """Return the lines."""
        return list(self._places)


class Questions:
    """The committed questions of a run, made into plain data some at a time: a large run does not fit in memory whole.

    Args:
        tables: `answers` and those of `OF_A_QUESTION`.
        rows: The run's rows, for its calls.
        images: Paths, below the run folder, of the thumbnails that exist.
        limit: Questions kept, in plan order.
        link: Put before those paths, so that a page elsewhere finds them.
    """

    def __init__(
        self,
        tables: Mapping[str, pd.DataFrame],
        rows: RunRows,
        images: Collection[str],
        limit: int,
        link: str = "",
    ) -> None:
        self._answers = tables["answers"].head(limit).reset_index(drop=True)
        self._tables = {name: tables[name] for name in OF_A_QUESTION}
        self._places = {name: table.groupby("question_id").indices for name, table in self._tables.items()}
        self._rows, self._images, self._link = rows, images, link

    def __len__(self) -> int:
        return len(self._answers)

    def rows(self, name: str, question_id: str) -> list[dict[str, Any]]:
        """Return a question's rows of a table."""
        places = self._places[name].get(question_id)
        return [] if places is None else _rows(self._tables[name].iloc[places])

    def table(self, name: str) -> pd.DataFrame:
        """Return a table with all its rows."""
        return self._tables[name]

    @property
    def ids(self) -> list[str]:
        """Ids of the questions kept, in plan order."""
        return self._answers["question_id"].tolist()

    def listed(self) -> list[dict[str, Any]]:
        """Return what the list shows of every question."""
        arms = _by_question(self._tables["arms"], set(self.ids))
        return [
            _listed(row, {str(arm["arm"]): arm for arm in arms.get(row["question_id"], [])})
            for row in _rows(self._answers)
        ]

    def records(self, ids: Sequence[str], lines: Lines) -> dict[str, dict[str, Any]]:
        """Return questions with all that led to their answers, by id; without those that have no committed row.

        Args:
            ids: The questions.
            lines: Takes the lines of their requests; records hold their places.
        """
        kept = self._answers[self._answers["question_id"].isin(ids)]
        found = {"calls": _by_question(self._rows.of(ids, "calls"), set(ids))}
        for name, places in self._places.items():
            where = [places[question] for question in kept["question_id"] if question in places]
            table = self._tables[name]
            found[name] = _by_question(table.iloc[np.concatenate(where)] if where else table.head(0), set(ids))
        return {
            row["question_id"]: _record(
                row, {name: rows.get(row["question_id"], []) for name, rows in found.items()}, self._image, lines
            )
            for row in _rows(kept)
        }

    def _image(self, candidate: Mapping[str, Any]) -> str | None:
        image = image_name(candidate["scene"], candidate["candidate"], list(candidate["world_to_camera"]))
        return self._link + image if image in self._images else None


def labels_of(status: str, arms: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the labels of a question.

    Args:
        status: How it ended.
        arms: Its arms by name, each with task, answer, views, chosen, mark and iou.
    """
    found = [status] if status != "answered" else []
    last = arms.get(standing_arm(arms), {})
    right = _is_right(last)
    found.append("unscored" if right is None else "right" if right else "wrong")
    for label, first, second in (("novel", "initial", "final"), ("verify", "final", "verified")):
        if first not in arms or second not in arms:
            continue
        before, after = _score(arms[first]), _score(arms[second])
        if _said(arms[first]) != _said(arms[second]):
            found.append(label)
        if before is not None and after is not None and before != after:
            found.append(f"{label}-better" if after > before else f"{label}-worse")
    return found


def _listed(answer: Mapping[str, Any], arms: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    scores = [_rounded(_score(arms[name]), 1) for name in sorted(arms, key=place_of)]
    return {
        "id": answer["question_id"],
        "scene": answer["scene"],
        "task": answer["task"],
        "category": answer["category"],
        "question": _cut(answer["question"], LISTED),
        "reference": _cut(_plain(answer["reference"]) or "", LISTED),
        "answer": _cut(answer["answer"], LISTED) if answer["status"] == "answered" else answer["status"],
        "labels": labels_of(str(answer["status"]), arms),
        "scores": scores,
    }


def _record(
    answer: dict[str, Any],
    rows: Mapping[str, list[dict[str, Any]]],
    image: Callable[[Mapping[str, Any]], str | None],
    lines: Lines,
) -> dict[str, Any]:
    return {
        "id": answer["question_id"],
        "scene": answer["scene"],
        "task": answer["task"],
        "category": answer["category"],
        "method": answer["method"],
        "question": answer["question"],
        "reference": _plain(answer["reference"]),
        "evidence": list(answer["evidence"]),
        "activated": int(answer["activated"]),
        "clusters_kept": int(answer["clusters"]),
        "clusters_found": int(answer["clusters_found"]),
        "status": answer["status"],
        "reason": answer["reason"],
        "answer": answer["answer"],
        "stands": answer["arm"],
        "model": answer["model"],
        "saved": list(answer["saved"]),
        "labels": labels_of(str(answer["status"]), {str(arm["arm"]): arm for arm in rows["arms"]}),
        "arms": [_arm(arm) for arm in rows["arms"]],
        "clusterings": [
            [row["category"], int(row["activated"]), int(row["clusters"]), _rounded(row["epsilon_m"], 3)]
            for row in rows["clusterings"]
        ],
        "clusters": [_cluster(cluster, rows["candidates"], image) for cluster in rows["clusters"]],
        "regions": [[row["arm"], int(row["instance"]), row["view"], len(row["gaussians"])] for row in rows["regions"]],
        "calls": [_call(call, lines) for call in rows["calls"]],
        "seconds": [[row["stage"], _rounded(row["seconds"], 4)] for row in rows["timings"]],
    }


def _arm(arm: Mapping[str, Any]) -> dict[str, Any]:
    views, chosen = list(arm["views"]), [int(index) for index in arm["chosen"]]
    return {
        "arm": arm["arm"],
        "status": arm["status"],
        "reason": arm["reason"],
        "answer": arm["answer"],
        "views": views,
        "chosen": chosen,
        "mark": _integer(arm["mark"]),
        "mark_reason": arm["mark_reason"],
        "predicted": _integer(arm["predicted"]),
        "targets": _integer(arm["targets"]),
        "iou": _rounded(arm["iou"], 4),
        "region": _integer(arm["region_gaussians"]),
    }


def _cluster(
    cluster: Mapping[str, Any],
    candidates: Sequence[Mapping[str, Any]],
    image: Callable[[Mapping[str, Any]], str | None],
) -> dict[str, Any]:
    return {
        "cluster": int(cluster["cluster"]),
        "category": cluster["category"],
        "gaussians": int(cluster["gaussians"]),
        "centre": [_rounded(value, 2) for value in cluster["centre"]],
        "initial_view": cluster["initial_view"],
        "visibility": _rounded(cluster["visibility"], 4),
        "visible": int(cluster["visible"]),
        "final": cluster["final"],
        "candidates": [
            _candidate(candidate, image(candidate))
            for candidate in candidates
            if candidate["cluster"] == cluster["cluster"]
        ],
    }


def _candidate(candidate: Mapping[str, Any], image: str | None) -> dict[str, Any]:
    return {
        "candidate": candidate["candidate"],
        "move": candidate["move"],
        "requested_m": _rounded(candidate["requested_m"], 3),
        "moved_m": _rounded(candidate["moved_m"], 3),
        "visibility": _rounded(candidate["visibility"], 4),
        "source": candidate["source"],
        "answer": _plain(candidate["answer"]),
        "chosen": bool(candidate["chosen"]),
        "image": image,
        "area": _rounded(candidate["area"], 4),
        "pose": [_rounded(value, 4) for value in candidate["world_to_camera"]],
    }


def _call(call: Mapping[str, Any], lines: Lines) -> dict[str, Any]:
    return {
        "stage": call["stage"],
        "subject": call["subject"],
        "model": call["model"],
        "prompt": call["prompt_sha256"][:16],
        "sent": lines.places(call["prompt"]),
        "key": call["key"],
        "attempt": int(call["attempt"]),
        "outcome": call["outcome"],
        "tokens": [int(call["prompt_tokens"]), int(call["completion_tokens"])],
        "seconds": _rounded(call["latency_s"], 3),
        "usd": _rounded(call["usd"], 6),
        "cached": bool(call["cached"]),
        "reply": _cut(str(call["reply"]), REPLY_SHOWN),
    }


def _cut(text: str, characters: int) -> str:
    return text if len(text) <= characters else text[: characters - 1] + "…"


def _is_right(arm: Mapping[str, Any]) -> bool | None:
    score = _score(arm)
    if score is None:
        return None
    return score >= match_score(RIGHT_MARK) if arm["task"] == "eqa" else score > 100 * RIGHT_IOU


def _score(arm: Mapping[str, Any]) -> float | None:
    """0 to 100, None where unscored."""
    if not arm:
        return None
    value = arm["mark"] if arm["task"] == "eqa" else arm["iou"]
    if pd.isna(value):
        return None
    return match_score(int(value)) if arm["task"] == "eqa" else 100.0 * float(value)


def _said(arm: Mapping[str, Any]) -> tuple[Any, ...]:
    """What an arm answered: the text, and for grounding the views it named; other views alone change nothing said."""
    if arm["task"] == "eqa":
        return (arm["status"], arm["answer"])
    views = list(arm["views"])
    return (arm["status"], tuple(views[int(index)] for index in arm["chosen"] if int(index) < len(views)))


def _by_question(frame: pd.DataFrame, kept: set[str]) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {}
    for row in _rows(frame[frame["question_id"].isin(kept)]):
        found.setdefault(row["question_id"], []).append(row)
    return found


def _rows(frame: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def _plain(value: Any) -> str | None:
    return None if value is None or (isinstance(value, float) and pd.isna(value)) else str(value)


def _integer(value: Any) -> int | None:
    return None if pd.isna(value) else int(value)


def _rounded(value: Any, digits: int) -> float | None:
    return None if pd.isna(value) else round(float(value), digits)
