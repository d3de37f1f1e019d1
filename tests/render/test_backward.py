"""The numpy level of the backward pass: activation in float32, memory kept and given back, slabs, whole vectors."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from llvmlite import binding
from numba import njit

from pipeline.render import backward, blend_backward_kernels
from pipeline.render.activate_backward_kernels import activate, bound_blocks
from pipeline.render.backward import RawGaussians, draw
from pipeline.render.prepare import prepare
from pipeline.render.workspace import WORKSPACE, Workspace
from pipeline.scene.gaussians import Gaussians
from tests.render.scenes import camera, gaussians, random_scene

LARGEST_RELATIVE = 1e-6
"""Of an activated number in float32 against float64: a rotation's numbers see about eight roundings."""


def raw_of(scene: Gaussians) -> RawGaussians:
    return RawGaussians(*(np.array(getattr(scene, name)) for name in RawGaussians.__slots__))


def activated(raw: RawGaussians) -> np.ndarray:
    """Mean, axes and log2 opacity of every Gaussian."""
    count = len(raw.means)
    blocks = np.arange(-(-count // 128), dtype=np.int32)
    geometry = np.full(len(blocks) * 128 * 13, np.nan, np.float32)
    flat = (raw.means.reshape(-1), raw.quats.reshape(-1), raw.log_scales.reshape(-1), raw.opacity_logits)
    activate(*flat, blocks, 0, len(blocks), geometry)
    rows = geometry.reshape(-1, 13, 8).swapaxes(1, 2).reshape(-1, 13)
    assert np.all(rows[count:, 12] == -np.inf)
    return rows[:count]


class TestActivation:
    def test_equals_the_prepared_scene(self) -> None:
        scene = random_scene(1, 1000)
        prepared = prepare(scene)
        rows = prepared.geometry.swapaxes(1, 2).reshape(-1, 13)[: np.count_nonzero(prepared.ids >= 0)]
        found = activated(raw_of(scene))[prepared.ids[: len(rows)]]
        np.testing.assert_array_equal(found[:, :3], rows[:, :3])
        sizes = np.abs(rows[:, 3:12]).max(axis=1, keepdims=True)
        np.testing.assert_allclose(found[:, 3:12] / sizes, rows[:, 3:12] / sizes, atol=LARGEST_RELATIVE)
        np.testing.assert_allclose(found[:, 12], rows[:, 12], rtol=LARGEST_RELATIVE, atol=1e-7)

    @given(st.floats(-90, 90, width=32))
    def test_opacities_and_scales_hold_over_their_range(self, x: float) -> None:
        raw = raw_of(gaussians([[0, 0, 1.0]]))
        raw.opacity_logits[0], raw.log_scales[0] = x, min(x, 20.0)
        row = activated(raw)[0]
        true = -np.logaddexp(0.0, -np.float64(x)) / np.log(2)
        assert row[12] == pytest.approx(true, rel=LARGEST_RELATIVE, abs=1e-7)
        scale = np.exp(np.float64(min(x, 20.0)))
        assert row[3] == pytest.approx(scale if x > -87 else 0.0, rel=LARGEST_RELATIVE, abs=1e-37)

    def test_limits(self) -> None:
        raw = raw_of(gaussians(np.ones((4, 3))))
        raw.opacity_logits[:] = [np.inf, -np.inf, 0.0, 0.0]
        raw.log_scales[2], raw.quats[3] = -np.inf, 0.0
        rows = activated(raw)
        assert rows[0, 12] == 0.0
        assert rows[1, 12] == rows[3, 12] == -np.inf
        assert not rows[2, 3:12].any()

    def test_boxes_hold_their_gaussians(self) -> None:
        raw = raw_of(random_scene(2, 300))
        centers, halves, reach = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
        bound_blocks(raw.means.reshape(-1), raw.log_scales.reshape(-1), 0, 3, centers, halves, reach)
        for k in range(3):
            part = slice(128 * k, 128 * (k + 1))
            np.testing.assert_allclose(centers[k] - halves[k], raw.means[part].min(axis=0), rtol=1e-6)
            np.testing.assert_allclose(centers[k] + halves[k], raw.means[part].max(axis=0), rtol=1e-6)
            assert np.exp(raw.log_scales[part]).max() <= reach[k] <= 1.001 * np.exp(raw.log_scales[part]).max()


class TestMemory:
    def test_released_memory_is_used_again(self) -> None:
        raw, view = raw_of(random_scene(3, 200)), camera()
        WORKSPACE.clear()
        first = draw(raw, view, sh_degree=1)
        address = first._records.table.ctypes.data
        first.release()
        with pytest.raises(ValueError, match="released"):
            first.gradients(first.color)
        assert draw(raw, view, sh_degree=1)._records.table.ctypes.data == address

    def test_lent_memory_is_not_handed_out(self) -> None:
        space = Workspace()
        one = space.array("a", 100, np.float32)
        lent = space.lend("a", "never asked for")
        assert list(lent) == ["a"]
        assert not np.shares_memory(space.array("a", 100, np.float32), one)

    def test_the_larger_buffer_is_kept(self) -> None:
        space = Workspace()
        large = space.array("a", 1000, np.float32)
        lent = space.lend("a")
        space.array("a", 10, np.float32)
        space.give_back(lent)
        assert np.shares_memory(space.array("a", 1000, np.float32), large)


def test_blocks_without_a_gradient_are_left_out_exactly() -> None:
    """The pull at one pixel alone: all else is skipped, and the gradient is that pixel's."""
    raw, view = raw_of(random_scene(4, 300)), camera(64, 64)
    drawing = draw(raw, view, sh_degree=1)
    pull = np.zeros((64, 64, 3), np.float32)
    pull[20, 37] = 1.0
    alone = drawing.gradients(pull)
    pull[50, 3] = 1e-30
    assert np.count_nonzero(alone.opacity_logits) < np.count_nonzero(drawing.gradients(pull).opacity_logits)
    np.testing.assert_allclose(alone.means, drawing.gradients(pull).means, atol=1e-20)


@pytest.mark.skipif(
    not binding.get_host_cpu_features().get("avx2", False), reason="this machine has no AVX2"
)  # fmt: skip
def test_the_way_back_uses_whole_vectors(monkeypatch: pytest.MonkeyPatch) -> None:
    fresh = njit(nogil=True, error_model="numpy")(blend_backward_kernels.unblend.py_func)
    monkeypatch.setattr(backward, "unblend", fresh)
    drawing = draw(raw_of(random_scene(5, 50)), camera(32, 32), sh_degree=1)
    drawing.gradients(drawing.color)
    (text,) = fresh.inspect_asm().values()
    lines = text.splitlines()
    fused = [line for line in lines if re.search(r"\b[yz]mm\d", line) and re.search("vfn?m(add|sub)", line)]
    scalar = [line for line in lines if re.search(r"vfn?m(add|sub)\d+ss", line)]
    assert len(fused) >= 20
    assert len(scalar) < len(fused)
