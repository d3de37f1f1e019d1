"""How long `status` takes on a run of many units, each with failed questions: all their answers are opened once.

python -m benchmarks.status                          # 10,000 units of 100 questions
python -m benchmarks.status --units 1000 --watch 5
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from jobs.runs.failures import FailedRows
from jobs.runs.status import run_status
from schemas.answers import ANSWERS
from schemas.manifest_file import UNITS, Manifest, PartEntry, encode_manifest, numbered_uri
from schemas.parts import encode_part
from schemas.plan import PLAN_FILE, PlannedUnit, encode_plan
from schemas.questions import Question
from schemas.run_folder import RunFolder
from schemas.tables import TABLES
from tests.workers.fake_steps import answer

BEGUN = datetime(2026, 1, 1, tzinfo=UTC)
FAILED = 2
"""Failed questions a unit: each is a line of the diary, and the unit's answers are opened."""


def planned(units: int, questions: int) -> Iterator[PlannedUnit]:
    for index in range(units):
        scene = f"scene{index}"
        asked = tuple(Question(f"{scene}-{n}", scene, "eqa", "What is it?", answer="a") for n in range(questions))
        yield PlannedUnit(f"{index:032x}", index, scene, scene, "0" * 64, "splatreasoner", asked)


def write_run(folder: Path, units: int, questions: int) -> str:
    run = RunFolder(str(folder))
    diary: list[dict[str, Any]] = [{"time": BEGUN.isoformat(), "event": "started"}]
    calls = {"calls": 15 * questions, "cached": 0, "failed_tries": 0, "tokens": 9_000 * questions, "usd": 0.5}
    Path(numbered_uri(run.root, UNITS, "0")).parent.mkdir(parents=True)
    failed = {"status": "failed", "reason": "QuestionError: refused"}
    asked = next(planned(1, questions)).questions
    answers = encode_part(ANSWERS, [answer(q, **(failed if n < FAILED else {})) for n, q in enumerate(asked)])
    (folder / ANSWERS.name).mkdir()
    for unit in planned(units, questions):
        parts = {n: PartEntry(f"{n}/{unit.id}.parquet", "0" * 64, 1, 1, spec.version) for n, spec in TABLES.items()}
        path, sha256 = parts[ANSWERS.name].path, hashlib.sha256(answers).hexdigest()
        parts[ANSWERS.name] = PartEntry(path, sha256, len(answers), questions, ANSWERS.version)
        (folder / path).write_bytes(answers)
        manifest = Manifest(unit.id, questions, {"answered": questions - FAILED, "failed": FAILED}, parts)
        Path(numbered_uri(run.root, UNITS, unit.id)).write_bytes(encode_manifest(manifest))
        now = (BEGUN + timedelta(seconds=unit.index + 1)).isoformat()
        for question in unit.questions[:FAILED]:
            told = {"unit": unit.id, "question": question.question_id, "error": "QuestionError", "message": "refused"}
            diary.append({"time": now, "event": "failed", **told})
        diary.append({"time": now, "event": "committed", "unit": unit.id, "questions": questions, "calls": calls})
    (folder / PLAN_FILE).write_bytes(encode_plan(planned(units, questions)))
    (folder / "events.jsonl").write_text("".join(json.dumps(line) + "\n" for line in diary))
    run.write_run({"id": "benchmark", "name": "benchmark", "config": {}})
    return run.root


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--units", type=int, default=10_000)
    parser.add_argument("--questions", type=int, default=100, help="a unit")
    parser.add_argument("--watch", type=int, default=3, help="looks")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = write_run(Path(folder, "run"), asked.units, asked.questions)
        rows = FailedRows(run)
        for look in range(asked.watch):
            wall, cpu = time.perf_counter(), time.process_time()
            found = run_status(run, rows)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            size = f"{found.questions:,} questions in {found.units:,} units"
            print(f"look {look + 1}: {size}: {wall:.2f} s, {cpu:.2f} s CPU")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB, making the run included")


if __name__ == "__main__":
    main()
