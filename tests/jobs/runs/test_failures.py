"""Reasons of failed questions: the error in them, and how they are counted."""

from __future__ import annotations

import pytest

from jobs.runs.failures import Ended, Failure, by_error, error_of


@pytest.mark.parametrize(
    ("reason", "error", "message"),
    [
        ("QuestionError: refused: too long", "QuestionError", "refused: too long"),
        ("evidence: QuestionError: refused", "QuestionError", "refused"),
        ("error: zlib says so", "error", "zlib says so"),
        ("KeyError: 'a\\nb'", "KeyError", "'a\\nb'"),
        ("InputError: one\nand another", "InputError", "one\nand another"),
        ("the scene has no categories", "the scene has no categories", ""),
        ("no view of it: none is left", "no view of it: none is left", ""),
        ("", "", ""),
    ],
)
def test_error_of_names_the_class_whatever_stage_it_came_from(reason: str, error: str, message: str) -> None:
    assert error_of(reason) == (error, message)


def test_by_error_counts_kinds_and_tells_the_message_met_most() -> None:
    ended = [
        Ended("q1", "KeyError", "a"),
        Ended("q2", "QuestionError", "no reply is stored for call 1"),
        Ended("q3", "QuestionError", "refused"),
        Ended("q4", "QuestionError", "refused"),
    ]
    assert by_error(ended) == (Failure("QuestionError", "refused", 3, "q3"), Failure("KeyError", "a", 1, "q1"))
    assert by_error([]) == ()
