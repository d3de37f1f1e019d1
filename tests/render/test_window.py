"""A window of an image: the bits of the whole image, cut out, whatever reaches into it from outside."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.geometry import Camera, look_at
from pipeline.render import FAST, Rendering, RenderQuality, passes, prepare, render, visible_ids
from pipeline.render.culling import visible_blocks
from pipeline.render.lens import Lens
from pipeline.render.prepare import BLOCK
from pipeline.render.window import Tiles, Window
from pipeline.scene.gaussians import Gaussians
from schemas.errors import InputError
from tests.render.scenes import UP, assert_same_bits, camera, random_scene

COLUMNS, ROWS = 7, 5
SIZE = (105, 70)  # the last tiles are cut at both edges
OUTPUTS = [("dominant",), ("color", "depth", "alpha", "dominant")]


@st.composite
def windows(draw: st.DrawFn) -> Tiles:
    """Any non-empty rectangle of the image's tiles."""
    first_column, first_row = draw(st.integers(0, COLUMNS - 1)), draw(st.integers(0, ROWS - 1))
    return first_column, first_row, draw(st.integers(first_column + 1, COLUMNS)), draw(st.integers(first_row + 1, ROWS))


def cropped(whole: Rendering, tiles: Tiles) -> Rendering:
    """Cut these tiles out of a rendering of the whole image."""
    first_column, first_row, last_column, last_row = (16 * edge for edge in tiles)
    images = {name: getattr(whole, name) for name in whole.__slots__}
    return Rendering(
        **{
            name: None if image is None else image[first_row:last_row, first_column:last_column]
            for name, image in images.items()
        }
    )


def long_scene(seed: int, stretch: float) -> Gaussians:
    """Random Gaussians in several blocks, whose first axes are `stretch` times as long."""
    scene = random_scene(seed, 3 * BLOCK, sh_degree=1)
    log_scales = scene.log_scales + np.array([np.log(stretch), 0, 0], np.float32)
    return Gaussians(scene.means, scene.quats, log_scales, scene.opacity_logits, scene.sh)


@given(
    seed=st.integers(0, 2**31),
    tiles=windows(),
    stretch=st.sampled_from([1.0, 10.0, 1000.0]),
    eye=st.tuples(*[st.floats(-4, 4)] * 3),
    near=st.floats(0, 4),
    center=st.tuples(st.floats(-50, 150), st.floats(-50, 150)),
    antialias=st.booleans(),
    outputs=st.sampled_from(OUTPUTS),
    threads=st.sampled_from([1, 2]),
    quality=st.sampled_from([RenderQuality(), FAST]),
)
@settings(max_examples=60, deadline=None)
def test_a_window_is_the_whole_image_cut_out(
    seed, tiles, stretch, eye, near, center, antialias, outputs, threads, quality
) -> None:
    K = np.array([[80.0, 0, center[0]], [0, 70, center[1]], [0, 0, 1]])
    view = Camera(K, look_at(np.array(eye) + 1e-3, np.array([0.0, 0, 5.0]), UP), *SIZE)
    prepared = prepare(long_scene(seed, stretch))
    chosen = {"near": near, "antialias": antialias, "threads": threads, "quality": quality}
    whole = cropped(render(prepared, view, outputs, **chosen), tiles)
    part = render(prepared, view, outputs, window=tiles, **chosen)
    assert_same_bits(part, whole)
    if outputs == ("dominant",) and not antialias:
        seen = visible_ids(prepared, view, near=near, threads=threads, quality=quality, window=tiles)
        np.testing.assert_array_equal(seen, np.unique(whole.dominant[whole.dominant >= 0]))


def test_a_window_cut_into_bands_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    prepared, view, tiles = prepare(long_scene(5, 10.0)), camera(*SIZE), (2, 1, 5, 5)
    whole = cropped(render(prepared, view), tiles)
    monkeypatch.setattr(passes, "BAND_TILES", 6)
    assert_same_bits(render(prepared, view, window=tiles), whole)


def test_the_whole_image_as_a_window_is_the_whole_image() -> None:
    prepared, view = prepare(random_scene(3)), camera(*SIZE)
    assert_same_bits(render(prepared, view, window=(0, 0, COLUMNS, ROWS)), render(prepared, view))


def test_a_small_window_looks_at_few_blocks_and_misses_none() -> None:
    scene = random_scene(4, 100_000, sh_degree=0)
    small = Gaussians(scene.means, scene.quats, scene.log_scales - 3, scene.opacity_logits, scene.sh)
    prepared, view, tiles = prepare(small), camera(*SIZE), (3, 2, 4, 3)
    lens = Lens.of(view)
    blocks = [len(visible_blocks(prepared, lens, Window.of(view, part), 0.2)) for part in (None, tiles)]
    assert 0 < blocks[1] < blocks[0] / 3
    whole = render(prepared, view, ("dominant",))
    for part in (tiles, (2, 1, 3, 2), (4, 3, 6, 4)):
        assert_same_bits(render(prepared, view, ("dominant",), window=part), cropped(whole, part))


@pytest.mark.parametrize("tiles", [(0, 0, 0, 1), (2, 0, 1, 1), (-1, 0, 1, 1), (0, 0, COLUMNS + 1, 1), (0, 0, 1, 6)])
def test_tiles_that_are_none_or_beyond_the_image_are_refused(tiles: Tiles) -> None:
    with pytest.raises(InputError, match="window"):
        render(random_scene(1, 5), camera(*SIZE), window=tiles)


def test_a_window_of_an_enlarged_image_is_refused() -> None:
    with pytest.raises(InputError, match="scale"):
        render(random_scene(1, 5), camera(*SIZE), window=(0, 0, 1, 1), quality=RenderQuality(scale=0.5))
