"""What storage costs: commits on disk and on S3, finding flipped bits, merging, and reading a large table.

    python -m benchmarks.storage [--units 256] [--rows 1000000] [--no-s3]

Times are CPU and wall time of this process. S3 is a moto server on this machine: its figures bound our own share
from above and say nothing about a network.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from schemas import compaction, storage
from schemas.committed import Committed
from schemas.manifest import all_manifests, commit_unit, damaged_units, load_manifest
from schemas.parts import decode_part, encode_part
from schemas.plan import PLAN_FILE, write_plan
from schemas.run_folder import RunFolder, read_table
from schemas.tables import TABLES
from tests.workers.fake_steps import answer, arm, candidate, unit

QUESTIONS = 25
"""Questions a unit, the job's default."""
FLIPS = 60


def rows_of(planned: Any) -> dict[str, list[Any]]:
    """Rows as a question leaves them: an answer, three arms, ten candidates."""
    questions = planned.questions
    return {
        "answers": [answer(q, answer="on the table, beside the lamp", evidence=("chair", "lamp")) for q in questions],
        "arms": [arm(q, name) for q in questions for name in ("initial", "final", "verified")],
        "candidates": [candidate(q) for q in questions for _ in range(10)],
    }


@contextmanager
def timed(label: str, count: int, what: str) -> Iterator[None]:
    wall, cpu = time.perf_counter(), time.process_time()
    yield
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    print(f"{label}: {1e3 * wall / count:.2f} ms wall, {1e3 * cpu / count:.2f} ms CPU {what}")


def commits(run: str, units: list[Any], label: str) -> None:
    rows = [rows_of(planned) for planned in units]
    with timed(f"commit, {label}", len(units), f"a unit of {QUESTIONS} questions, 3 tables"):
        for planned, own in zip(units, rows, strict=True):
            assert commit_unit(run, planned.id, own).won


def flips(run: str, name: str) -> None:
    draw, found, silent = random.Random(0), 0, 0
    manifest = load_manifest(run, name)
    files = [(TABLES[table], Path(run, entry.path), entry.sha256) for table, entry in manifest.parts.items()]
    for _ in range(FLIPS):
        spec, path, sha256 = draw.choice(files)
        data = bytearray(path.read_bytes())
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        for expected in (sha256, None):
            try:
                decode_part(spec, bytes(data), path, expected)
            except storage.InputError:
                found += expected is not None
            else:
                silent += expected is None
    print(
        f"flipped bits: {found} of {FLIPS} found; by page checksums alone {FLIPS - silent} (the others touch no value)"
    )


def merge(run: str, units: list[Any]) -> None:
    before = storage.list_files(run, recursive=True)
    size = sum(Path(run, name).stat().st_size for name in before)
    with timed("merge", len(units) * QUESTIONS, "a question"):
        compaction.compact(run, [planned.id for planned in units])
    after = storage.list_files(run, recursive=True)
    merged = sum(Path(run, name).stat().st_size for name in after)
    print(f"merge: {len(before)} files, {size / 1e6:.1f} MB to {len(after)} files, {merged / 1e6:.1f} MB")
    with timed("look at what is committed, merged", len(units), "a unit"):
        assert len(Committed.load(run).units) == len(units)
    with timed("all manifests, merged", len(units), "a unit"):
        assert sum(manifest.questions for manifest in all_manifests(run)) == len(units) * QUESTIONS
    with timed("verify every byte, merged", len(units), "a unit"):
        assert not list(damaged_units(run))


def large(rows: int) -> None:
    """Read a table of many rows: part by part, then as one frame."""
    with tempfile.TemporaryDirectory(prefix="splatreasoner-") as place:
        folder, many = RunFolder(place), 6_400
        units = [unit(index, ["q"] * many, f"s{index}") for index in range(-(-rows // many))]
        planned = write_plan(folder.uri(PLAN_FILE), iter(units))
        folder.write_run({"name": "large", "plan": {"sha256": planned.sha256}})
        size = 0
        for planned_unit in units:
            commit = commit_unit(place, planned_unit.id, {"answers": [answer(q) for q in planned_unit.questions]})
            size += commit.manifest.parts["answers"].bytes
        del units
        before = _peak_mb()
        with timed("read by parts", rows, "a row"):
            read = sum(part.num_rows for part in folder.parts("answers"))
        streamed = _peak_mb()
        with timed("read_table", rows, "a row"):
            frame = read_table(place, "answers")
        assert len(frame) == read
        print(
            f"{read} rows, {size / 1e6:.1f} MB on disk: by parts {streamed - before:.0f} MB more at the peak, "
            f"as a frame {_peak_mb() - before:.0f} MB more"
        )


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=256)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--no-s3", action="store_true")
    options = parser.parse_args()
    units = [unit(index, ["where is it?"] * QUESTIONS, f"scene{index}") for index in range(options.units)]
    large(options.rows)
    with tempfile.TemporaryDirectory(prefix="splatreasoner-") as run:
        commits(run, units, "local")
        data = encode_part(TABLES["answers"], rows_of(units[0])["answers"])
        with timed("one file, synced and renamed", 50, "a file"):
            for number in range(50):
                storage.write_bytes_atomic(storage.join(run, "x", str(number)), data)
        for number in range(50):
            storage.remove(storage.join(run, "x", str(number)))
        flips(run, units[0].id)
        merge(run, units)
    if not options.no_s3:
        from tests.schemas.s3_server import Server, address, keys

        os.environ.update(keys())
        server = Server()
        try:
            commits(address(server.port), units[:32], "S3 (moto, this machine)")
            with timed("look at what is committed, S3", 32, "a unit"):
                Committed.load(address(server.port))
        finally:
            server.close()


if __name__ == "__main__":
    main()
