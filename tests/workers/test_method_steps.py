"""The seam to the real method: the steps travel by name."""

from __future__ import annotations

import pickle

from workers.method_steps import METHOD_STEPS


def test_steps_pickle_by_name() -> None:
    assert pickle.loads(pickle.dumps(METHOD_STEPS)) == METHOD_STEPS
    assert len(pickle.dumps(METHOD_STEPS)) < 2_000
