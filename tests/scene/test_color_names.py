"""Colour names: prototypes, shading, and the vote."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.scene.color_names import COLOR_NAMES, dominant_color, name_color, name_colors

PROTOTYPES = {
    "black": ["#000000", "#202020", "#1a1a22"],
    "white": ["#ffffff", "#f0f0f0", "#faf5e6"],
    "gray": ["#808080", "#a0a0a0", "#606060"],
    "red": ["#ff0000", "#c02020", "#a01818", "#dc143c"],
    "green": ["#00ff00", "#208020", "#3a6b35", "#6b8e23", "#90ee90"],
    "blue": ["#0000ff", "#2040a0", "#4682b4", "#87ceeb", "#1e3a6e"],
    "yellow": ["#ffff00", "#f0d020", "#e6c440", "#ffd700"],
    "orange": ["#ff8000", "#e07020", "#ffa500"],
    "purple": ["#800080", "#6a3d9a", "#9370db"],
    "pink": ["#ffc0cb", "#ff69b4", "#e090a8"],
    "brown": ["#8b4513", "#a0522d", "#654321", "#c19a6b", "#7a5230", "#4a3020"],
}


def rgb(code: str) -> np.ndarray:
    return np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


@pytest.mark.parametrize(("name", "code"), [(n, c) for n, codes in PROTOTYPES.items() for c in codes])
def test_name_color_agrees_with_common_paint_names(name: str, code: str) -> None:
    assert name_color(rgb(code)) == name


@pytest.mark.parametrize("name", ["red", "green", "blue", "purple", "brown", "black"])
@pytest.mark.parametrize("shade", [0.9, 0.75, 0.6])
def test_name_color_survives_shading(name: str, shade: float) -> None:
    assert {name_color(rgb(code) * shade) for code in PROTOTYPES[name]} == {name}


@given(value=st.floats(0, 1))
def test_name_color_of_neutral_light_is_black_gray_or_white(value: float) -> None:
    assert name_color(np.full(3, value)) in ("black", "gray", "white")


@given(st.lists(st.tuples(*[st.floats(-0.5, 1.5)] * 3), min_size=1, max_size=20))
def test_name_colors_agrees_with_one_at_a_time_and_clips(values: list[tuple[float, float, float]]) -> None:
    colors = np.array(values)
    ids = name_colors(colors)
    assert [COLOR_NAMES[i] for i in ids] == [name_color(color) for color in np.clip(colors, 0, 1)]


def test_dominant_color_takes_the_most_frequent_name() -> None:
    colors = np.stack([rgb("#ff0000"), rgb("#0000ff"), rgb("#1030c0"), rgb("#00ff00")])
    assert dominant_color(colors) == "blue"


def test_dominant_color_of_nothing_is_empty() -> None:
    assert dominant_color(np.zeros((0, 3))) == ""
