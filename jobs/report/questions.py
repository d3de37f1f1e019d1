"""What the page knows of each question: plain data, one dict a question, with the labels that filters use."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import pandas as pd

from pipeline.metrics.llm_match import match_score
from schemas.run_folder import image_name

RIGHT_MARK = 4
"""Least LLM-Match mark of a right answer: the judge finds at most a detail wrong."""
RIGHT_IOU = 0.1
"""A grounding is right above this IoU: the stricter of the paper's two thresholds."""

REPLY_SHOWN = 600
"""Characters of a reply on the page; the tables hold it whole."""

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


def question_records(tables: Mapping[str, pd.DataFrame], images: Collection[str], limit: int) -> list[dict[str, Any]]:
    """Return the first `limit` questions with all that led to their answers.

    Args:
        tables: `answers`, `arms`, `clusters`, `candidates` and `calls`.
        images: Paths, below the run folder, of the thumbnails that exist.
        limit: Questions kept.
    """
    answers = tables["answers"].head(limit)
    kept = set(answers["question_id"])
    by_question = {name: _by_question(tables[name], kept) for name in ("arms", "clusters", "candidates", "calls")}
    return [
        _record(row, {name: rows.get(row["question_id"], []) for name, rows in by_question.items()}, images)
        for row in _rows(answers)
    ]


def labels_of(status: str, arms: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the labels of a question.

    Args:
        status: How it ended.
        arms: Its arms by name, each with task, answer, views, chosen, mark and iou.
    """
    found = [status] if status != "answered" else []
    last = arms.get("verified", {})
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


def _record(
    answer: dict[str, Any], rows: Mapping[str, list[dict[str, Any]]], images: Collection[str]
) -> dict[str, Any]:
    arms = {str(arm["arm"]): arm for arm in rows["arms"]}
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
        "labels": labels_of(str(answer["status"]), arms),
        "arms": [_arm(arm) for arm in rows["arms"]],
        "clusters": [_cluster(cluster, rows["candidates"], images) for cluster in rows["clusters"]],
        "calls": [_call(call) for call in rows["calls"]],
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
    cluster: Mapping[str, Any], candidates: Sequence[Mapping[str, Any]], images: Collection[str]
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
            _candidate(candidate, images) for candidate in candidates if candidate["cluster"] == cluster["cluster"]
        ],
    }


def _candidate(candidate: Mapping[str, Any], images: Collection[str]) -> dict[str, Any]:
    image = image_name(candidate["scene"], candidate["candidate"], list(candidate["world_to_camera"]))
    return {
        "candidate": candidate["candidate"],
        "move": candidate["move"],
        "requested_m": _rounded(candidate["requested_m"], 3),
        "moved_m": _rounded(candidate["moved_m"], 3),
        "visibility": _rounded(candidate["visibility"], 4),
        "source": candidate["source"],
        "answer": _plain(candidate["answer"]),
        "chosen": bool(candidate["chosen"]),
        "image": image if image in images else None,
    }


def _call(call: Mapping[str, Any]) -> dict[str, Any]:
    reply = str(call["reply"])
    return {
        "stage": call["stage"],
        "subject": call["subject"],
        "model": call["model"],
        "attempt": int(call["attempt"]),
        "outcome": call["outcome"],
        "tokens": [int(call["prompt_tokens"]), int(call["completion_tokens"])],
        "seconds": _rounded(call["latency_s"], 3),
        "cached": bool(call["cached"]),
        "reply": reply if len(reply) <= REPLY_SHOWN else reply[: REPLY_SHOWN - 1] + "…",
    }


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
