"""Splitting work over threads: every piece once, errors seen, one thread means the caller's."""

from __future__ import annotations

import threading

import pytest

from pipeline.render.threads import run_each, split


@pytest.mark.parametrize(("total", "parts"), [(0, 4), (1, 4), (7, 3), (12, 4), (5, 1), (3, 100)])
def test_split_covers_everything_once_in_order(total: int, parts: int) -> None:
    ranges = split(total, parts)
    assert [k for first, last in ranges for k in range(first, last)] == list(range(total))
    assert len(ranges) <= parts
    sizes = [last - first for first, last in ranges]
    assert not sizes or max(sizes) - min(sizes) <= 1


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_run_each_does_every_piece_once(threads: int) -> None:
    done: list[int] = []
    run_each(done.append, 50, threads)
    assert sorted(done) == list(range(50))


def test_one_thread_stays_in_the_caller() -> None:
    seen: set[int] = set()
    run_each(lambda k: seen.add(threading.get_ident()), 5, 1)
    assert seen == {threading.get_ident()}


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_in_a_piece_is_raised(threads: int) -> None:
    def fail(k: int) -> None:
        if k == 7:
            raise ValueError("piece 7")

    with pytest.raises(ValueError, match="piece 7"):
        run_each(fail, 20, threads)
