"""Arguments, outputs, threads, bands and buffers of `render`, and what importing it costs."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.render import OUTPUTS, color_image, passes, prepare, render, render_reference
from pipeline.render.workspace import WORKSPACE
from schemas.errors import InputError
from tests.render.scenes import assert_same_bits, camera, front_camera, gaussians, random_scene

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("draw", [render, render_reference])
@pytest.mark.parametrize("name", OUTPUTS)
def test_outputs_not_asked_for_are_none_and_the_others_do_not_change(name: str, draw) -> None:
    scene, view = random_scene(1, 60), camera(40, 30)
    full, one = draw(scene, view), draw(scene, view, (name,))
    for field in ("color", "depth", "alpha", "dominant", "dominant_weight"):
        if field.startswith(name):
            np.testing.assert_array_equal(getattr(one, field), getattr(full, field))
        else:
            assert getattr(one, field) is None


@pytest.mark.parametrize("draw", [render, render_reference])
@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"outputs": ("colour",)}, "outputs"),
        ({"outputs": ()}, "outputs"),
        ({"outputs": "color"}, "outputs"),
        ({"sh_degree": 2}, "sh_degree"),
        ({"sh_degree": -1}, "sh_degree"),
        ({"near": -0.1}, "near"),
        ({"near": float("nan")}, "near"),
    ],
)
def test_bad_argument_is_an_input_error_that_names_it(arguments: dict, field: str, draw) -> None:
    with pytest.raises(InputError, match=f"render: {field}"):
        draw(random_scene(1, 5), camera(8, 8), **arguments)


def test_zero_threads_is_an_input_error() -> None:
    with pytest.raises(InputError, match="threads"):
        render(random_scene(1, 5), camera(8, 8), threads=0)


@pytest.mark.parametrize("outputs", [OUTPUTS, ("dominant",), ("color",)])
def test_any_number_of_threads_gives_the_same_bits(outputs: tuple[str, ...]) -> None:
    prepared, view = prepare(random_scene(2, 3000)), camera(130, 90)
    one = render(prepared, view, outputs)
    for threads in (2, 3, 8):
        assert_same_bits(one, render(prepared, view, outputs, threads=threads))


def test_prepared_and_raw_gaussians_give_the_same_bits_and_nothing_is_written() -> None:
    scene, view = random_scene(3), camera()
    prepared = prepare(scene)
    assert not any(getattr(prepared, name).flags.writeable for name in ("geometry", "ids", "sh", "block_reach"))
    assert_same_bits(render(scene, view), render(prepared, view))


def test_prepared_gaussians_survive_pickling() -> None:
    prepared, view = prepare(random_scene(4)), camera()
    assert_same_bits(render(prepared, view), render(pickle.loads(pickle.dumps(prepared)), view))


@pytest.mark.parametrize(
    ("constant", "value"), [("BAND_TILES", 20), ("BAND_TILES", 1), ("SMALLEST_SLAB", 7), ("PIECES_PER_THREAD", 1)]
)
@pytest.mark.parametrize("outputs", [OUTPUTS, ("dominant",)])
@pytest.mark.parametrize("threads", [1, 2])
def test_bands_slabs_and_pieces_of_any_size_give_the_same_bits(
    constant: str, value: int, outputs: tuple[str, ...], threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared, view = prepare(random_scene(5, 600)), camera(130, 90)
    whole = render(prepared, view, outputs)
    monkeypatch.setattr(passes, constant, value)
    monkeypatch.setattr(passes, "SLAB_KEYS_PER_TILE", 0 if constant == "SMALLEST_SLAB" else 32)
    assert_same_bits(whole, render(prepared, view, outputs, threads=threads))


@pytest.mark.parametrize("threads", [1, 3])
def test_slabs_whose_pairs_do_not_fit_give_the_same_bits(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every Gaussian covers all tiles, so a slab ends long before its keys do."""
    rng = np.random.default_rng(0)
    scene = gaussians(rng.uniform(1, 3, (900, 3)), scales=9.0, opacity_logits=-4.5, colors=rng.uniform(0, 1, (900, 3)))
    view = front_camera(130, 90)
    whole = render(scene, view)
    monkeypatch.setattr(passes, "SMALLEST_SLAB", 900)
    monkeypatch.setattr(passes, "SLAB_KEYS_PER_TILE", 0)
    assert_same_bits(whole, render(scene, view, threads=threads))
    np.testing.assert_allclose(whole.alpha, render_reference(scene, view).alpha, atol=1e-5)


@pytest.mark.parametrize("outputs", [OUTPUTS, ("dominant",)])
@pytest.mark.parametrize("byte", [0x00, 0x7F, 0xC7, 0xFF])
def test_every_output_element_is_written(outputs: tuple[str, ...], byte: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Outputs and scratch memory that start as noise change nothing, also where no Gaussian is seen."""
    plain_empty = np.empty

    def noise(shape, dtype=float, **more):
        array = plain_empty(shape, dtype, **more)
        array.view(np.uint8)[...] = byte
        return array

    for scene in (random_scene(6, 40), gaussians([[0, 0, -1.0]])):
        expected = render(scene, front_camera(37, 21), outputs)
        WORKSPACE.fill(byte)
        with monkeypatch.context() as patch:
            patch.setattr(np, "empty", noise)
            found = render(scene, front_camera(37, 21), outputs)
        assert_same_bits(expected, found)


def test_scratch_memory_can_be_given_back() -> None:
    scene, view = random_scene(7, 40), camera(20, 20)
    expected = render(scene, view)
    WORKSPACE.clear()
    assert_same_bits(expected, render(scene, view))


def test_color_image_cuts_to_eight_bits() -> None:
    scene = gaussians([[0, 0, 2.0]], scales=9.0, opacity_logits=np.inf, colors=(7.0, -3.0, 0.5))
    pixel = color_image(render(scene, front_camera(), ("color",)))[16, 16]
    np.testing.assert_array_equal(pixel, [255, 0, 126])
    with pytest.raises(ValueError, match="no colour"):
        color_image(render(scene, front_camera(), ("depth",)))


def test_importing_the_package_does_not_import_numba() -> None:
    code = "import sys, pipeline.render; sys.exit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
