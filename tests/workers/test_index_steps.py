"""The index across processes and runs: parts add up to the whole, and what one rendered nobody renders again."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from pipeline.config import MethodConfig
from pipeline.query.visibility import VisibilityConfig
from pipeline.tasks.context import SceneContext
from tests.query.tiny import tiny_scene
from workers.index_steps import (
    IndexPart,
    adopt_index,
    adopt_rows,
    index_views,
    join_index,
    keep_rows,
    read_index,
)

SCENE = tiny_scene()
CONFIG = MethodConfig()
CLUSTERS = [np.arange(start, start + 60, dtype=np.int32) for start in range(0, 600, 60)]


def other(value: Any) -> Any:
    """A value as another process gets it."""
    return pickle.loads(pickle.dumps(value))


def frames(context: SceneContext, config: MethodConfig = CONFIG) -> int:
    return context.index(config.visibility).work.frames


@pytest.mark.parametrize("parts", [1, 2, 4, 9])
def test_parts_rendered_by_many_give_the_counts_of_one(tmp_path: Path, parts: int) -> None:
    whole = SceneContext(SCENE).index(CONFIG.visibility).counts(CLUSTERS).visible
    found = read_index(SCENE, CONFIG, str(tmp_path))
    assert (dict(found.rows), found.unstored.views, found.damaged) == ({}, [0, 1, 2, 3, 4, 5], ())
    workers = [SceneContext(SCENE) for _ in range(parts)]
    rendered = [index_views(worker, CONFIG, found.unstored, part, parts) for part, worker in enumerate(workers)]
    assert sum(frames(worker) for worker in workers) == 6
    joined = join_index(SCENE, CONFIG, other([IndexPart.of(found.rows), *rendered]))
    here = SceneContext(SCENE)
    adopt_index(here, CONFIG, other(joined))
    np.testing.assert_array_equal(here.index(CONFIG.visibility).counts(CLUSTERS).visible, whole)
    assert frames(here) == 0
    again = read_index(SCENE, CONFIG, str(tmp_path))
    assert again.unstored.views == []
    stored = join_index(SCENE, CONFIG, [IndexPart.of(again.rows)])
    np.testing.assert_array_equal(cast(Any, stored).views, cast(Any, joined).views)


def test_rows_rendered_when_needed_are_kept_once_and_read_back(tmp_path: Path) -> None:
    first, unstored = SceneContext(SCENE), read_index(SCENE, CONFIG, str(tmp_path)).unstored
    first.index(CONFIG.visibility).ids(2)
    assert keep_rows(first, CONFIG, unstored) == 1
    assert keep_rows(first, CONFIG, unstored) == 0
    first.index(CONFIG.visibility).ids(4)
    assert keep_rows(first, CONFIG, unstored) == 1
    assert unstored.views == [0, 1, 3, 5]
    found, second = read_index(SCENE, CONFIG, str(tmp_path)), SceneContext(SCENE)
    adopt_rows(second, CONFIG, found.rows)
    second.index(CONFIG.visibility).build()
    assert frames(second) == 4


def test_views_that_a_config_leaves_out_are_neither_rendered_nor_stored(tmp_path: Path) -> None:
    half = CONFIG.model_copy(update={"visibility": VisibilityConfig(every_nth=2)})
    found, worker = read_index(SCENE, half, str(tmp_path)), SceneContext(SCENE)
    joined = join_index(SCENE, half, [index_views(worker, half, found.unstored, 0, 1)])
    assert frames(worker, half) == 3
    here = SceneContext(SCENE)
    adopt_index(here, half, joined)
    seen = here.index(half.visibility).counts(CLUSTERS).visible
    np.testing.assert_array_equal(seen, worker.index(half.visibility).counts(CLUSTERS).visible)
    assert not seen[:, 1::2].any()
    assert read_index(SCENE, CONFIG, str(tmp_path)).unstored.views == [1, 3, 5], "the other views' rows are shared"


def test_lazy_config_renders_nothing_ahead(tmp_path: Path) -> None:
    lazy = CONFIG.model_copy(update={"visibility": VisibilityConfig(build="lazy")})
    store = read_index(SCENE, lazy, str(tmp_path)).unstored.store
    store.write({3: SceneContext(SCENE).index(lazy.visibility).ids(3)})
    found, worker = read_index(SCENE, lazy, str(tmp_path)), SceneContext(SCENE)
    part = index_views(worker, lazy, found.unstored, 0, 1)
    assert len(part.views) == frames(worker, lazy) == 0
    adopt_index(worker, lazy, other(join_index(SCENE, lazy, [IndexPart.of(found.rows), part])))
    index = worker.index(lazy.visibility)
    assert index.held(3) is not None
    assert index.missing == 5
