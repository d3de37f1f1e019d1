"""The seam to the real method: index parts add up to the whole, and the steps travel by name."""

from __future__ import annotations

import pickle
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pipeline.config import MethodConfig
from workers.method_steps import METHOD_STEPS, adopt_index, index_views


class FakeIndex:
    """Stands where VisibilityIndex does; counts what it had to render."""

    def __init__(self) -> None:
        self.rendered: list[int] = []
        self.rows: dict[int, Any] = {}

    def __len__(self) -> int:
        return 7

    def ids(self, view: int) -> Any:
        if view not in self.rows:
            self.rendered.append(view)
            self.rows[view] = np.arange(view, dtype=np.int32)
        return self.rows[view]

    def adopt(self, view: int, ids: Any) -> None:
        self.rows.setdefault(view, ids)


@pytest.mark.parametrize("parts", [1, 2, 3, 9])
def test_parts_of_the_index_make_the_whole_in_another_process(parts: int) -> None:
    here = FakeIndex()
    context = cast(Any, SimpleNamespace(index=lambda config: here))
    config = MethodConfig()
    for part in range(parts):
        there = FakeIndex()
        found, views = index_views(cast(Any, SimpleNamespace(index=lambda config, i=there: i)), config, part, parts)
        assert views == len(there.rendered)
        adopt_index(context, config, pickle.loads(pickle.dumps(found)))
    assert here.rendered == []
    assert sorted(here.rows) == list(range(7))
    for view, ids in here.rows.items():
        np.testing.assert_array_equal(ids, np.arange(view))


def test_steps_pickle_by_name() -> None:
    assert pickle.loads(pickle.dumps(METHOD_STEPS)) == METHOD_STEPS
    assert len(pickle.dumps(METHOD_STEPS)) < 2_000
