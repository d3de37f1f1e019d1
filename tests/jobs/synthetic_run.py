"""A small run folder as a real run leaves it, made up: every status, every task, and texts that try to break pages."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.models.prompts import BUILT_IN
from schemas.answers import AnswerRow, ArmRow
from schemas.calls import CallRow, TimingRow
from schemas.clusterings import ClusteringRow
from schemas.evidence import CandidateRow, ClusterRow
from schemas.manifest import commit_unit
from schemas.plan import PLAN_FILE, PlannedUnit, encode_plan
from schemas.questions import Question, Task
from schemas.run_folder import RunFolder, image_name

EVIL = "</script><script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\"> & 'q' \u2028 青"
SCENES = ("flat 1", "flat/2", "maison <b>3</b>")
CATEGORIES = ("object recognition", "object localization", "attribute recognition", "spatial understanding")
MOVES = ("initial", "left", "right", "forward", "backward")
TASKS: tuple[Task, ...] = ("eqa", "eqa", "ground_one", "ground_many")
ARMS = ("initial", "final", "verified")
POSE = (1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.25, 0.0, 0.0, 1.0, -1.0)


def synthetic_rows(questions: int = 60, seed: int = 0) -> dict[str, list[Any]]:
    """Return the rows of a run by table; the plan's questions are under "questions"."""
    rng = np.random.default_rng(seed)
    found: dict[str, list[Any]] = {
        name: []
        for name in ("questions", "answers", "arms", "clusterings", "clusters", "candidates", "calls", "timings")
    }
    for number in range(questions):
        _add_question(found, number, rng)
    for scene in SCENES[: min(len(SCENES), questions)]:
        found["timings"].append(TimingRow("", scene, "index", 4.0 + float(rng.random()), 120))
    return found


def write_run(
    folder: Path, questions: int = 60, seed: int = 0, *, committed: int | None = None, prompts: bool = True
) -> str:
    """Write the rows as a run folder, with thumbnails of the first questions, and return its path.

    Args:
        folder: Where.
        questions: How many.
        seed: Of everything that varies.
        committed: Units committed of one a scene; None for all.
        prompts: Whether calls hold the text of their requests.
    """
    rows = synthetic_rows(questions, seed)
    if not prompts:
        rows["calls"] = [replace(row, prompt="") for row in rows["calls"]]
    run = RunFolder(str(folder))
    units = []
    for index, scene in enumerate(SCENES):
        own = tuple(question for question in rows["questions"] if question.scene == scene)
        unit = PlannedUnit(f"{index:032x}", index, scene, f"scenes/{index}", "0" * 64, "splatreasoner", own)
        units.append(unit)
        if committed is None or index < committed:
            tables = {name: [r for r in rows[name] if r.scene == scene] for name in rows if name != "questions"}
            commit_unit(run.root, unit.id, tables)
    (folder / PLAN_FILE).write_bytes(encode_plan(units))
    symbolic = {"kind": "symbolic"}
    run.write_run(
        {
            "format": 1,
            "name": "synthetic " + EVIL,
            "created": "2026-01-01T00:00:00+00:00",
            "config": {"name": EVIL, "method": {"evidence": {"k": 3}}},
            "basis": {"models": {"evidence": symbolic, "judge": symbolic}, "prompts": {"judge": "0" * 64}},
            "versions": {"numpy": "2.4"},
            "commit": "0123456789abcdef",
        }
    )
    pictured = {question.question_id for question in rows["questions"][:12]}
    for candidate in rows["candidates"]:
        if candidate.move != "backward" and candidate.question_id in pictured:
            _picture(folder / image_name(candidate.scene, candidate.candidate, candidate.world_to_camera))
    return run.root


def _add_question(found: dict[str, list[Any]], number: int, rng: np.random.Generator) -> None:
    scene, task = SCENES[number % len(SCENES)], TASKS[number % len(TASKS)]
    name, category = f"q{number:04d}", CATEGORIES[number % 4 if task == "eqa" else 3] if task == "eqa" else f"{task} x"
    text = f"What stands beside the lamp of room {number}? {EVIL if number % 7 == 0 else ''}".strip()
    status = {5: "failed", 11: "unparsed", 17: "skipped"}.get(number % 20, "answered")
    reason = {
        "failed": "QuestionError: refused",
        "unparsed": "the answer could not be read",
        "skipped": "nothing there",
    }
    reference = None if number % 23 == 0 else "a green sofa"
    targets = (0, 1, 3)[number % 3] if task == "ground_many" else 1
    found["questions"].append(
        Question(name, scene, task, text, answer=reference, category=category, target_ids=tuple(range(targets)))
    )
    marks = _marks(rng) if task == "eqa" else (None,) * 3
    ious = np.clip(rng.normal(0.15, 0.12, 3) + np.array([0, 0.04, 0.05]), 0, 1) if task != "eqa" else [None] * 3
    views = [[f"frame_{number:03d}", f"frame_{number + 1:03d}"], [f"frame_{number:03d}/0/left", "frame_009"]]
    scored = status == "answered" and (reference is not None or task != "eqa")
    for arm, mark, iou in zip(ARMS, marks, ious, strict=True):
        found["arms"].append(
            ArmRow(
                question_id=name,
                scene=scene,
                task=task,
                category=category,
                method="splatreasoner",
                arm=arm,
                status=status,
                reason=reason.get(status, ""),
                answer=f"A {'green' if arm != 'initial' else 'red'} sofa. {EVIL if number % 7 == 0 else ''}",
                views=tuple(views[arm != "initial"]),
                chosen=() if task == "eqa" else (1,),
                frames=2,
                mark=mark if scored else None,
                mark_reason="" if scored else "no reference" if status == "answered" else status,
                predicted=None if task == "eqa" or status != "answered" else 1,
                targets=None if task == "eqa" else targets,
                iou=float(iou) if scored and iou is not None else None,
                region_gaussians=None if task == "eqa" else 1234,
                pair_ious=(float(iou),) * min(1, targets) if task == "ground_many" and status == "answered" else None,
            )
        )
    found["answers"].append(
        AnswerRow(
            question_id=name,
            scene=scene,
            task=task,
            category=category,
            method="splatreasoner",
            question=text,
            reference=reference,
            evidence=("sofa", "lamp"),
            activated=4321,
            clusters=2,
            clusters_found=3,
            status=status,
            reason=reason.get(status, ""),
            answer="A green sofa." if status == "answered" else "",
            arm="final",
            frames=2,
            model="symbolic",
        )
    )
    _add_views(found, name, scene, number, rng)
    _add_calls(found, name, scene, rng)


def _marks(rng: np.random.Generator) -> Sequence[int]:
    first = int(rng.integers(1, 6))
    return first, min(5, max(1, first + int(rng.integers(-1, 3)))), min(5, max(1, first + int(rng.integers(0, 3))))


def _add_views(found: dict[str, list[Any]], name: str, scene: str, number: int, rng: np.random.Generator) -> None:
    for cluster, category in enumerate(("sofa", "lamp")):
        quality = (2, 0.875, 1, 0, 2) if category == "sofa" else (None,) * 5
        found["clusterings"].append(
            ClusteringRow(name, scene, category, 1000, 0.2, 3, 50, 900 if category == "sofa" else 0, *quality)
        )
        view = f"frame_{number + cluster:03d}"
        found["clusters"].append(
            ClusterRow(name, scene, cluster, category, 900, (1.0, 2.5, 0.4), view, 0.41, 369, f"{view}/{cluster}/left")
        )
        for place, move in enumerate(MOVES):
            candidate = view if move == "initial" else f"{view}/{cluster}/{move}"
            found["candidates"].append(
                CandidateRow(
                    question_id=name,
                    scene=scene,
                    cluster=cluster,
                    candidate=candidate,
                    move=move,
                    world_to_camera=tuple(value + 0.01 * place for value in POSE),
                    requested_m=0.0 if move == "initial" else 0.3,
                    moved_m=0.0 if move == "initial" else (0.12 if move == "forward" else 0.3),
                    visibility=float(rng.random()),
                    area=0.125,
                    centring=0.25,
                    truncation=0.5,
                    touches_border=True,
                    new_gaussians=7,
                    unobserved=None,
                    floaters=0.0625,
                    source="photo" if move == "initial" else "render",
                    answer=None if move == "backward" else f"I see a sofa {EVIL if number % 7 == 0 else ''}",
                    chosen=move == "left",
                )
            )


def _add_calls(found: dict[str, list[Any]], name: str, scene: str, rng: np.random.Generator) -> None:
    stages = ("evidence", *["view_answer"] * 8, "choice", "choice", "answer", "answer", "verify", "judge", "judge")
    for place, stage in enumerate(stages):
        outcome = "unparsed" if rng.random() < 0.03 else "RateLimitError" if rng.random() < 0.02 else "ok"
        found["calls"].append(
            CallRow(
                question_id=name,
                scene=scene,
                stage=stage,
                subject=f"frame_{place:03d}",
                key=hashlib.sha256(f"{name}{place}".encode()).hexdigest(),
                endpoint="symbolic",
                model="symbolic",
                prompt_sha256="0" * 64,
                attempt=1,
                outcome=outcome,
                reply="A sofa. " * (200 if place == 3 else 1),
                prompt_tokens=600,
                completion_tokens=20,
                wait_s=0.0,
                latency_s=float(rng.random()) / 10,
                usd=None,
                cached=bool(rng.random() < 0.3),
                prompt=_prompt(stage, name, place),
            )
        )
    for stage, seconds in (("cluster", 0.3), ("render", 0.9), ("view_answer", 0.2), ("answer", 0.05), ("judge", 0.01)):
        found["timings"].append(TimingRow(name, scene, stage, seconds * float(rng.random() + 0.5), 4))


def _prompt(stage: str, name: str, place: int) -> str:
    """Return a prompt of the size and likeness of a real one."""
    template = (BUILT_IN / f"{'answer_one' if stage == 'answer' else stage}.txt").read_text(encoding="utf-8")
    image = hashlib.sha256(f"{name}{place}".encode()).hexdigest()[:16]
    filled = template.partition("=== again")[0].replace("{{images}}", f"Image 0\n[image {image}]")
    return filled.replace("{{question}}", f"What stands beside the lamp of {name}? {EVIL if place == 0 else ''}")


def _picture(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    seed = int(hashlib.sha256(path.name.encode()).hexdigest()[:8], 16)
    pixels = np.random.default_rng(seed).integers(60, 220, (6, 8, 3), np.uint8)
    sink = io.BytesIO()
    Image.fromarray(pixels).resize((256, 192)).save(sink, "JPEG")
    path.write_bytes(sink.getvalue())
