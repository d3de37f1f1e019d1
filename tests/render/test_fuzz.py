"""Gaussians made of random bits and of damaged files: whatever the loader lets through renders, and renders sanely."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.render import Rendering, render, render_reference
from pipeline.scene.formats import read_gaussians
from pipeline.scene.formats.ply import ply_bytes
from pipeline.scene.formats.raw import RawGaussians, keep_usable
from pipeline.scene.gaussians import Gaussians
from schemas.errors import InputError
from tests.render.scenes import assert_same_bits, front_camera, random_scene
from tests.scene.encoders import spz

DAMAGED = 120
"""Damaged copies a format: a few milliseconds each."""

MAKERS = {
    "damaged.ply": lambda: ply_bytes(random_scene(1, 40)),
    "damaged.spz": lambda: spz(random_scene(1, 40), compress=False),
}


def assert_sane(scene: Gaussians) -> Rendering:
    """Every output is finite and in range, all agree on what was seen, and dominance alone gives the same bits."""
    view = front_camera(33, 21, focal=20.0)
    found = render(scene, view)
    for image in (found.color, found.depth, found.alpha, found.dominant_weight):
        assert np.isfinite(image).all()
    assert (found.color >= 0).all()
    assert ((found.alpha >= 0) & (found.alpha <= 1)).all()
    assert ((found.dominant >= -1) & (found.dominant < len(scene))).all()
    np.testing.assert_array_equal(found.dominant >= 0, found.alpha > 0)
    alone = render(scene, view, ("dominant",))
    np.testing.assert_array_equal(alone.dominant, found.dominant)
    assert_same_bits(found, render(scene, view, threads=2))
    return found


def _random_bits(seed: int) -> Gaussians:
    """Floats of any bit pattern; what the loader would drop is dropped."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 40))

    def bits(*shape: int) -> np.ndarray:
        return np.frombuffer(rng.bytes(4 * int(np.prod(shape))), np.float32).reshape(shape).copy()

    # Random bits are mostly far out of sight or of no size: half of the scenes keep some arrays ordinary.
    means = rng.uniform([-1, -1, 1], [1, 1, 4], (count, 3)).astype(np.float32) if seed % 2 else bits(count, 3)
    logits = rng.normal(0, 3, count).astype(np.float32) if seed % 4 > 1 else bits(count)
    raw = RawGaussians(means, bits(count, 4), bits(count, 3), logits, bits(count, 4, 3))
    with np.errstate(all="ignore"):
        return keep_usable(raw)[0]


@given(seed=st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_render_gaussians_of_random_bits_is_sane(seed: int) -> None:
    assert_sane(_random_bits(seed))


@pytest.mark.parametrize("name", MAKERS)
def test_damaged_file_is_refused_or_renders_sanely_and_like_the_reference(tmp_path: Path, name: str) -> None:
    data, rng, rendered, close = MAKERS[name](), np.random.default_rng(9), 0, 0
    for _ in range(DAMAGED):
        damaged = bytearray(data)
        for at in rng.integers(0, len(data), rng.integers(1, 20)):
            damaged[at] = rng.integers(256)
        (tmp_path / name).write_bytes(damaged)
        try:
            scene = read_gaussians(str(tmp_path / name)).gaussians
        except InputError:
            continue
        found = assert_sane(scene)
        rendered += 1
        truth = render_reference(scene, front_camera(33, 21, focal=20.0), ("alpha",))
        close += np.mean(np.abs(found.alpha - truth.alpha) > 1e-3) < 0.01
    assert rendered > DAMAGED // 4
    assert close == rendered
