"""Puts what `make chaos` measured into docs/reliability.md: `python -m tests.jobs.chaos.table MEASURED.jsonl`."""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tests.conftest import ROOT
from tests.jobs.chaos.faults import FAULTS

PAGE = ROOT / "docs" / "reliability.md"
BEGIN, END = "<!-- measured: begin -->\n", "<!-- measured: end -->\n"
HEAD = (
    "| fault | promise | tests | exit | seconds | rows equal | sent twice | also |\n|---|---|---|---|---|---|---|---|\n"
)

Line = Mapping[str, Any]


def table(lines: Iterable[Line]) -> str:
    """Return the table: a row a fault, of all tests that did it; a dash where nothing was measured."""
    by_fault: dict[str, list[Line]] = defaultdict(list)
    for line in lines:
        by_fault[line["fault"]].append(line)
    return HEAD + "".join(
        f"| {fault.name} | {fault.promise} | {' | '.join(_cells(by_fault[fault.name]))} |\n" for fault in FAULTS
    )


def _cells(lines: list[Line]) -> list[str]:
    if not lines:
        return ["-"] * 6
    exits = sorted({code for line in lines for code in line["exits"] or ()})
    seconds = [line["seconds"] for line in lines if line["seconds"] is not None]
    equal, failed = (sum(line[field] for line in lines) for field in ("equal", "failed"))
    twice = [line["sent_twice"] for line in lines if line["sent_twice"] is not None]
    notes = list(dict.fromkeys(line["note"] for line in lines if line["note"]))
    return [
        str(len(lines)),
        ", ".join(map(str, exits)) or "killed",
        f"{max(seconds):g}" if seconds else "",
        f"{equal} of {equal + failed}",
        str(sum(twice)) if twice else "",
        "; ".join(notes),
    ]


def latest(text: str) -> list[Line]:
    """Return the last line of each test."""
    return list({line["test"]: line for line in map(json.loads, text.splitlines())}.values())


def filled(page: str, lines: Iterable[Line]) -> str:
    """Return the page with the table in its place."""
    before, _, rest = page.partition(BEGIN)
    return before + BEGIN + table(lines) + END + rest.partition(END)[2]


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(), latest(Path(sys.argv[1]).read_text())))
