from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from workers.pace import MOST_TOGETHER, Limits, Pace

SOME = st.integers(1, 1000)


@given(
    limits=st.builds(
        Limits,
        in_flight=SOME,
        timeout_s=st.just(1.0),
        retries=st.just(0),
        batch=st.none() | SOME,
        batches=st.none() | SOME,
        slots=st.integers(1, 64),
        memory=st.none() | st.integers(1, 10**9),
    ),
    learned=st.lists(st.tuples(SOME, st.floats(0, 1e4), st.integers(0, 10**10)), max_size=5),
)
def test_no_bound_is_passed_and_work_never_stands_still(limits: Limits, learned: list[tuple[int, float, int]]) -> None:
    pace = Pace(limits)
    for questions, seconds, held in learned:
        pace.learn(questions, seconds, held)
    assert 1 <= pace.together <= pace.window <= limits.in_flight
    assert pace.together <= (limits.batch or MOST_TOGETHER)
    questions = batches = 0
    while pace.room(questions, batches):
        questions, batches = questions + pace.together, batches + 1
    assert 1 <= questions <= pace.window
    assert limits.batches is None or batches <= limits.batches


def test_bytes_a_question_rise_at_once_and_fall_slowly() -> None:
    pace = Pace(Limits(in_flight=1000, timeout_s=1.0, retries=0, memory=10_000))
    pace.learn(10, 1.0, 1_000)
    assert pace.window == 100
    pace.learn(1, 1.0, 1_000)
    assert pace.window == 10
    pace.learn(10, 1.0, 1_000)
    assert pace.window == 12
    for _ in range(60):
        pace.learn(10, 1.0, 1_000)
    assert pace.window == 99


def test_nothing_is_known_of_bytes_before_the_first_batch_has_ended() -> None:
    assert Pace(Limits(in_flight=7, timeout_s=1.0, retries=0, memory=1)).window == 7
