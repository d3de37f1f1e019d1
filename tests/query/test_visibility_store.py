from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.geometry import Camera
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex
from pipeline.query.visibility_store import RENDERER_VERSION, VisibilityStore, space_of, view_key
from pipeline.render import prepare, visible_ids
from pipeline.scene.gaussians import Gaussians
from tests.query.tiny import camera_at, gaussians_at, tiny_scene

CONFIG = VisibilityConfig()
SCENE = tiny_scene()
CAMERAS = [view.camera for view in SCENE.views]


def store_of(root: Path, cameras: list[Camera] = CAMERAS, config: VisibilityConfig = CONFIG) -> VisibilityStore:
    return VisibilityStore.of(str(root), SCENE.gaussians, cameras, config)


def rendered(cameras: list[Camera] = CAMERAS, config: VisibilityConfig = CONFIG) -> dict[int, np.ndarray]:
    index = VisibilityIndex(prepare(SCENE.gaussians), cameras, config)
    return {view: index.ids(view) for view in range(len(cameras))}


def test_stored_rows_come_back_as_they_were_rendered(tmp_path: Path) -> None:
    rows = rendered()
    store_of(tmp_path).write(rows)
    found = store_of(tmp_path).read()
    assert list(found.ids) == list(range(6))
    assert found.damaged == ()
    for view, ids in rows.items():
        np.testing.assert_array_equal(found.ids[view], ids)


def test_views_added_later_and_another_order_find_the_rows_of_the_old_ones(tmp_path: Path) -> None:
    rows = rendered()
    store_of(tmp_path, CAMERAS[:4]).write({view: rows[view] for view in range(4)})
    found = store_of(tmp_path, CAMERAS[::-1]).read()
    assert sorted(found.ids) == [2, 3, 4, 5]
    np.testing.assert_array_equal(found.ids[5], rows[0])
    store_of(tmp_path).write({view: rows[view] for view in (4, 5)})
    assert len(store_of(tmp_path).read().ids) == 6


def test_reduced_size_and_near_plane_have_rows_of_their_own(tmp_path: Path) -> None:
    store_of(tmp_path).write(rendered())
    for config in (VisibilityConfig(long_side=24), VisibilityConfig(near_m=0.3), VisibilityConfig(min_opacity=0.5)):
        assert not store_of(tmp_path, config=config).read().ids
    # Renders that a larger bound does not touch are the same renders.
    assert len(store_of(tmp_path, config=VisibilityConfig(long_side=48, every_nth=2)).read().ids) == 6


def test_any_change_of_what_a_render_reads_misses() -> None:
    gaussians, camera = SCENE.gaussians, CAMERAS[0]
    before = space_of(gaussians, CONFIG)
    for name in ("means", "quats", "log_scales", "opacity_logits"):
        changed = getattr(gaussians, name).copy()
        changed.reshape(-1)[-1] = np.nextafter(changed.reshape(-1)[-1], np.float32(9))
        assert space_of(dataclasses.replace(gaussians, **{name: changed}), CONFIG) != before, name
    assert space_of(gaussians.take(np.arange(len(gaussians))[::-1]), CONFIG) != before
    assert space_of(dataclasses.replace(gaussians, sh=gaussians.sh * 2), CONFIG) == before, "no colour is read"
    K, pose = camera.K.copy(), camera.world_to_camera.copy()
    K[0, 2] += 1e-9
    pose[2, 3] += 1e-9
    changes: list[dict[str, Any]] = [{"K": K}, {"world_to_camera": pose}, {"width": 49}, {"height": 35}]
    keys = {view_key(dataclasses.replace(camera, **change)) for change in changes}
    assert len(keys | {view_key(camera)}) == 5


def test_damaged_part_is_told_removed_and_its_rows_are_missing(tmp_path: Path) -> None:
    rows, store = rendered(), store_of(tmp_path)
    store.write({view: rows[view] for view in range(3)})
    (part,) = tmp_path.rglob("*.arrow")
    store.write({view: rows[view] for view in range(3, 6)})
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(bytes(data))
    found = store.read()
    assert sorted(found.ids) == [3, 4, 5]
    assert len(found.damaged) == 1
    assert str(part) in found.damaged[0]
    assert not part.exists()
    store.write({view: rows[view] for view in range(3)})
    assert part.exists(), "the same rows make the same part again"
    again = store.read()
    assert len(again.ids) == 6
    assert again.damaged == ()


def test_new_setting_is_part_of_the_key_until_somebody_says_otherwise() -> None:
    known = {"build", "near_m", "long_side", "exact_top", "min_opacity", "every_nth", "most_views"}
    assert set(VisibilityConfig.model_fields) == known, "does the new setting change rows? see SAME_ROWS"


def test_dominant_ids_are_those_of_the_renderer_version() -> None:
    """Where this fails since dominance was changed on purpose: raise RENDERER_VERSION and renew the hash."""
    rng = np.random.default_rng(12)
    count = 4000
    base = gaussians_at(rng.uniform((-2, 1, -1), (2, 6, 2), (count, 3)))
    gaussians = Gaussians(
        means=base.means,
        quats=rng.normal(size=(count, 4)).astype(np.float32),
        log_scales=rng.uniform(-4.5, -1.5, (count, 3)).astype(np.float32),
        opacity_logits=rng.uniform(-4, 4, count).astype(np.float32),
        sh=base.sh,
    )
    ids = visible_ids(gaussians, camera_at((0, -1, 0.5), (0, 3, 0.5), 160, 120))
    assert 400 < len(ids) < count
    assert (RENDERER_VERSION, hashlib.sha256(ids).hexdigest()[:16]) == (1, "9f8847ac8c22478a")


def test_write_of_nothing_makes_no_folder(tmp_path: Path) -> None:
    store_of(tmp_path / "none").write({})
    assert not (tmp_path / "none").exists()
    assert store_of(tmp_path / "none").read().ids == {}


@pytest.mark.parametrize("count", [0, 1])
def test_row_without_an_id_is_a_row(tmp_path: Path, count: int) -> None:
    store_of(tmp_path).write({2: np.arange(count, dtype=np.int32)})
    assert store_of(tmp_path).read().ids[2].tolist() == list(range(count))
