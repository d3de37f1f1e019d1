from __future__ import annotations

import json
import sys
from typing import Any

import pytest

from jobs.runs.progress import (
    LINE_S,
    Bar,
    JsonLines,
    Lines,
    Silent,
    Style,
    for_terminal,
    on_terminal,
    progress_style,
)
from jobs.runs.spend import CallTotals
from schemas.errors import InputError

PRICED = CallTotals(calls=3, cached=1, failed_tries=1, tokens=1_000, usd=0.25)


def drive(progress: Any, now: list[float]) -> None:
    """Thirty questions, eight done before, a minute of loading, then one a second; one fails."""
    progress.begin(total=30, done=8)
    now[0] = 60.0
    progress.advance("")
    progress.spent(PRICED)
    for _ in range(20):
        now[0] += 1.0
        progress.advance("QuestionError" if now[0] == 61.0 else "")
    progress.advance("")
    progress.say("a word")
    progress.end()


def test_lines_say_rate_and_time_left_from_the_first_question_on(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    drive(Lines(lambda: now[0]), now)
    assert capsys.readouterr().err.splitlines() == [
        "30 questions, 8 done before",
        "9/30 questions",
        "19/30 questions, 1.0/s, 11 s left, 1 failed, 2 calls, 1000 tokens, 0.25 USD",
        "29/30 questions, 1.0/s, 1 s left, 1 failed, 2 calls, 1000 tokens, 0.25 USD",
        "30/30 questions, 1.1/s, 0 s left, 1 failed, 2 calls, 1000 tokens, 0.25 USD",
        "a word",
        "failed questions: QuestionError 1",
    ]
    assert LINE_S == 10.0


def test_json_lines_are_one_object_each_with_what_is_known(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    drive(JsonLines(lambda: now[0]), now)
    told = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [line["event"] for line in told] == ["begin", *["progress"] * 4, "message", "end"]
    assert all("time" in line and line["items"] == "questions" for line in told)
    assert {"calls", "rate"} & set(told[0]) == set()
    first, second = told[1:3]
    assert (first["done"], first["rate"], first["left_s"]) == (9, None, None)
    assert (second["done"], second["total"], second["failed"], second["rate"], second["left_s"]) == (
        19,
        30,
        1,
        1.0,
        11.0,
    )
    assert second["calls"] == {"calls": 3, "cached": 1, "failed_tries": 1, "tokens": 1000, "usd": 0.25}
    assert told[-2]["text"] == "a word"
    assert told[-1]["errors"] == {"QuestionError": 1}


def test_bar_ends_with_the_errors_and_may_end_before_it_began(capsys: pytest.CaptureFixture[str]) -> None:
    bar = Bar()
    bar.end()
    bar.begin(total=2, done=0)
    bar.spent(PRICED)
    bar.advance("RetryError")
    bar.say("a [line] in brackets")
    bar.advance("")
    bar.end()
    told = capsys.readouterr().err
    assert "a [line] in brackets" in told
    assert "failed questions: RetryError 1" in told


def test_off_a_terminal_it_is_json_unless_told_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    for terminal, style, kind in (
        (False, None, JsonLines),
        (True, None, Bar),
        (True, Style.JSON, JsonLines),
        (False, Style.PLAIN, Lines),
    ):
        monkeypatch.setattr(sys.stderr, "isatty", lambda found=terminal: found)
        assert type(for_terminal(style=style)) is kind


def test_style_of_flags_that_contradict_each_other_is_refused() -> None:
    assert progress_style(plain=False, log_json=False) is None
    assert progress_style(plain=True, log_json=False) is Style.PLAIN
    assert progress_style(plain=False, log_json=True) is Style.JSON
    with pytest.raises(InputError, match="--plain"):
        progress_style(plain=True, log_json=True)


def test_json_lines_that_never_began_do_not_end(capsys: pytest.CaptureFixture[str]) -> None:
    JsonLines().end()
    assert capsys.readouterr().err == ""


def test_off_a_terminal_work_that_nobody_collects_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    for terminal, kind in ((True, Bar), (False, Silent)):
        monkeypatch.setattr(sys.stderr, "isatty", lambda found=terminal: found)
        assert type(on_terminal("questions written")) is kind
