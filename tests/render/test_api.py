"""Arguments, outputs, threads, bands and buffers of `render`, and what importing it costs."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.render import OUTPUTS, color_image, passes, prepare, render, render_reference
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
    assert not any(getattr(prepared, name).flags.writeable for name in ("geometry", "ids", "sh", "means"))
    assert_same_bits(render(scene, view), render(prepared, view))


def test_prepared_gaussians_survive_pickling() -> None:
    prepared, view = prepare(random_scene(4)), camera()
    assert_same_bits(render(prepared, view), render(pickle.loads(pickle.dumps(prepared)), view))


def test_frames_too_large_for_one_band_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, view = random_scene(5), camera(130, 90)
    whole = render(scene, view)
    monkeypatch.setattr(passes, "LARGEST_ENTRIES", 50)
    assert_same_bits(whole, render(scene, view))


@pytest.mark.parametrize("outputs", [OUTPUTS, ("dominant",)])
def test_every_output_element_is_written(outputs: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Buffers that start as noise change nothing, also where no Gaussian is seen."""
    plain_empty = np.empty

    def noise(shape, dtype=float, **more):
        array = plain_empty(shape, dtype, **more)
        array.view(np.uint8)[...] = 0xC7
        return array

    for scene in (random_scene(6, 40), gaussians([[0, 0, -1.0]])):
        expected = render(scene, front_camera(37, 21), outputs)
        with monkeypatch.context() as patch:
            patch.setattr(np, "empty", noise)
            found = render(scene, front_camera(37, 21), outputs)
        assert_same_bits(expected, found)


def test_color_image_cuts_to_eight_bits() -> None:
    scene = gaussians([[0, 0, 2.0]], scales=9.0, opacity_logits=np.inf, colors=(7.0, -3.0, 0.5))
    pixel = color_image(render(scene, front_camera(), ("color",)))[16, 16]
    np.testing.assert_array_equal(pixel, [255, 0, 126])
    with pytest.raises(ValueError, match="no colour"):
        color_image(render(scene, front_camera(), ("depth",)))


def test_importing_the_package_does_not_import_numba() -> None:
    code = "import sys, pipeline.render; sys.exit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
