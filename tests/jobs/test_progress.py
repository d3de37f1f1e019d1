from __future__ import annotations

import pytest

from jobs.progress import LINE_S, Bar, Lines


def test_lines_say_rate_and_time_left_from_the_first_question_on(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    lines = Lines(lambda: now[0])
    lines.begin(total=30, done=8)
    now[0] = 60.0  # loading
    lines.advance("")
    for _ in range(20):
        now[0] += 1.0
        lines.advance("QuestionError" if now[0] == 61.0 else "")
    lines.advance("")
    lines.end()
    assert capsys.readouterr().err.splitlines() == [
        "30 questions, 8 done before",
        "9/30 questions",
        "19/30 questions, 1.0/s, 11 s left, 1 failed",
        "29/30 questions, 1.0/s, 1 s left, 1 failed",
        "30/30 questions, 1.1/s, 0 s left, 1 failed",
        "failed questions: QuestionError 1",
    ]
    assert LINE_S == 10.0


def test_bar_ends_with_the_errors_and_may_end_before_it_began(capsys: pytest.CaptureFixture[str]) -> None:
    bar = Bar()
    bar.end()
    bar.begin(total=2, done=0)
    bar.advance("RetryError")
    bar.say("a [line] in brackets")
    bar.advance("")
    bar.end()
    told = capsys.readouterr().err
    assert "a [line] in brackets" in told
    assert "failed questions: RetryError 1" in told
