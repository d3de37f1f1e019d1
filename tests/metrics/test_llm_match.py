"""LLM-Match: the mapping of marks, what the judge is shown, and that unscored is not zero."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.metrics.llm_match import LlmMatch, cut_prediction, llm_match, match_score, needs_judge


@pytest.mark.parametrize(("mark", "score"), [(0, 0), (1, 0), (2, 25), (3, 50), (4, 75), (5, 100), (6, 100)])
def test_match_score_maps_marks_to_hundred(mark: int, score: float) -> None:
    assert match_score(mark) == score


@given(st.lists(st.integers(0, 5), min_size=1))
def test_llm_match_is_the_protocols_formula(marks: list[int]) -> None:
    expected = np.mean(100.0 * (np.clip(marks, 1, 5) - 1) / 4)
    assert llm_match(marks).mean == pytest.approx(expected)


@given(st.lists(st.one_of(st.none(), st.integers(0, 5))))
def test_llm_match_unscored_questions_change_only_the_count(marks: list[int | None]) -> None:
    scored = [mark for mark in marks if mark is not None]
    result = llm_match(marks)
    assert (result.mean, result.scored) == (llm_match(scored).mean, len(scored))
    assert result.unscored == len(marks) - len(scored)


def test_llm_match_of_nothing_has_no_mean() -> None:
    assert llm_match([]) == LlmMatch(None, 0, 0)
    assert llm_match([None, None]) == LlmMatch(None, 0, 2)


@pytest.mark.parametrize(
    ("prediction", "shown"),
    [
        ("On the desk.", "On the desk."),
        ("On the desk. It is", "On the desk."),
        ("A. B. C", "A. B."),
        ("On the desk", "On the desk"),
        ("", ""),
        (".", "."),
        ("About 2.5 m", "About 2."),
    ],
)
def test_cut_prediction_ends_at_the_last_full_stop(prediction: str, shown: str) -> None:
    assert cut_prediction(prediction) == shown


def test_needs_judge_only_for_words() -> None:
    assert [needs_judge(text) for text in (None, "", " \n", "no")] == [False, False, False, True]
