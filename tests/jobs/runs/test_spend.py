"""What calls cost, of rows, of the diary and of the journals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from jobs.runs import spend
from jobs.runs.spend import CallTotals, paid
from pipeline.models.admission import Done, Wish
from pipeline.models.journal import Journal
from schemas.calls import CallRow

CALL = CallRow("q", "s", "answer", "", "k", "e", "m", "p", 1, "ok", "r", 100, 10, 0.0, 2.0, 0.25, False)


def test_totals_count_what_was_sent_and_tell_apart_what_was_found_or_failed() -> None:
    rows = [
        CALL,
        replace(CALL, outcome="unparsed"),
        replace(CALL, cached=True, usd=0.0),
        replace(CALL, outcome="RateLimitError", prompt_tokens=0, completion_tokens=0, usd=None),
    ]
    totals = CallTotals.of(rows)
    assert totals == CallTotals(calls=3, cached=1, failed_tries=1, tokens=220, usd=0.5)
    assert totals.sent == 2
    assert CallTotals.of([]) == CallTotals()


def test_a_price_of_which_a_part_is_unknown_is_unknown() -> None:
    assert CallTotals.of([CALL, replace(CALL, usd=None)]).usd is None
    assert (CallTotals.of([CALL]) + CallTotals.of([replace(CALL, usd=None)])).usd is None
    assert (CallTotals.of([CALL]) + CallTotals.of([CALL])).usd == 0.5


def test_events_come_back_and_fields_of_later_versions_are_passed_over() -> None:
    totals = CallTotals.of([CALL])
    assert CallTotals.read({**totals.as_event(), "kilowatts": 3}) == totals


def test_paid_counts_calls_that_no_committed_row_tells_of(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "e.jsonl", "first session")
    journal.record(Wish("a:1", 50, 0.5, "k1"))
    journal.record(Done("a:1", 40, 0.4))
    journal.record(Wish("a:2", 70, 0.7, "k2"))  # its process was killed
    Journal(tmp_path / "f.jsonl", "second").record(Wish("b:1", 5, 0.05, "k3"))
    found = paid(str(tmp_path))
    assert found is not None
    assert (found.calls, found.tokens) == (3, 115)
    assert found.usd == pytest.approx(1.15)


def test_paid_is_unknown_without_journals_and_where_they_are_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert paid(str(tmp_path)) is None
    Journal(tmp_path / "e.jsonl", "s").record(Wish("a:1", 50, 0.5, "k1"))
    monkeypatch.setattr(spend, "JOURNALS_READ", 10)
    assert paid(str(tmp_path)) is None
