"""The pieces procedural scenes are made of: plans, cells, cuts, samples, textures and highlights."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.scene.procedural.cells import SIGMA, line_cells, line_counts
from pipeline.scene.procedural.cutting import Faces, cut, rectangle_without, without_hidden
from pipeline.scene.procedural.floor_grid import flood
from pipeline.scene.procedural.furniture import BUILDERS
from pipeline.scene.procedural.highlights import C0, basis, to_sh
from pipeline.scene.procedural.layout import WALL_M, make_layout
from pipeline.scene.procedural.paint import PALETTE, Paint, Texture
from pipeline.scene.procedural.sampling import sample
from pipeline.scene.procedural.shape import Shape
from pipeline.scene.procedural.surfaces import collect, grids, side_lengths
from pipeline.scene.procedural.texture import brightness
from pipeline.scene.procedural.walk import shortest

GRAY = Paint(PALETTE["gray"])


@given(count=st.integers(1, 14), seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_plans_are_connected_and_rooms_keep_apart(count: int, seed: int) -> None:
    layout = make_layout(count, np.random.default_rng(seed))
    assert len({room.name for room in layout.rooms}) == count
    for i, a in enumerate(layout.rooms):
        assert a.area > 4
        for b in layout.rooms[:i]:
            apart = [max(b.low[k] - a.high[k], a.low[k] - b.high[k]) for k in (0, 1)]
            assert max(apart) > WALL_M - 0.01
    reached = {0}
    for _ in range(count):
        for way in layout.doorways:
            if way.passable and reached & {way.below, way.above}:
                reached |= {way.below, way.above} - {-1}
    assert reached == set(range(count))
    assert sum(-1 in (way.below, way.above) for way in layout.doorways) == 1


@given(steps=st.floats(0.01, 60.0), low=st.booleans(), high=st.booleans())
def test_cells_cover_their_length_evenly(steps: float, low: bool, high: bool) -> None:
    joined = np.array([[low, high]])
    n = int(line_counts(np.array([steps]), joined)[0])
    index = np.arange(n)
    middle, width = line_cells(np.full(n, n), index, np.zeros(n), np.repeat(joined, n, axis=0))
    assert (np.diff(middle) > 0).all()
    assert middle[0] > 0
    assert middle[-1] < 1
    sigma = SIGMA * width[:, None]
    x = np.linspace(0.0, 1.0, 400)
    alpha = 0.97 * np.exp(-0.5 * ((x - middle[:, None]) / sigma) ** 2)
    covered = 1 - (1 - alpha).prod(axis=0)
    # At a joined end the neighbouring surface adds its half.
    assert covered.min() > (0.45 if n > 1 or not (low or high) else 0.3)
    assert np.median(covered) > 0.6


@given(
    hole=st.tuples(*[st.floats(-0.5, 1.5)] * 4),
    joins=st.tuples(*[st.booleans()] * 4),
)
def test_cutting_a_rectangle_keeps_the_rest_of_its_area(
    hole: tuple[float, float, float, float], joins: tuple[bool, bool, bool, bool]
) -> None:
    u0, u1 = sorted(hole[::2])
    v0, v1 = sorted(hole[1::2])
    parts = rectangle_without((0.0, 0.0, 1.0, 1.0), joins, (u0, v0, u1, v1))
    inside = max(0.0, min(u1, 1) - max(u0, 0)) * max(0.0, min(v1, 1) - max(v0, 0))
    area = sum((p[2] - p[0]) * (p[3] - p[1]) for p, _ in parts)
    assert area == pytest.approx(1 - inside, abs=1e-5)


def test_a_cover_hides_only_what_is_right_behind_it() -> None:
    wall = Shape()
    wall.quad(np.array([[0, 0, 0], [4, 0, 0], [0, 0, 2], [4, 0, 2]], float), GRAY)
    cover = Faces(
        np.array([0]), np.array([1]), np.array([-1]), np.array([[1.0, -0.01, 0.5]]), np.array([[2.0, -0.01, 1.0]])
    )
    assert len(cut(wall, cover).kinds) == 8
    far = Faces(cover.surface, cover.axis, cover.sign, cover.low - [0, 0.1, 0], cover.high - [0, 0.1, 0])
    assert len(cut(wall, far).kinds) == 1
    turned = Faces(cover.surface, cover.axis, -cover.sign, cover.low, cover.high)
    assert len(cut(wall, turned).kinds) == 1


def test_blocks_face_outwards() -> None:
    shape = Shape()
    shape.block((1.0, 2.0, 0.5), (0.4, 0.6, 0.8), GRAY, top=(0.7, 0.9))
    shape.tube((0.0, 0.0, 0.0), 0.2, 0.5, GRAY, tip=0.6)
    shape.ball((3.0, 0.0, 0.0), (0.2, 0.3, 0.4), GRAY)
    surfaces = collect([shape])
    counts = grids(surfaces, side_lengths(surfaces), np.full(len(shape.kinds), 0.05))
    (chunk,) = sample(surfaces, counts, np.random.default_rng(0))
    middles = np.array([[1.0, 2.0, 0.9]] * 6 + [[0.0, 0.0, 0.25]] * 3 + [[3.0, 0.0, 0.0]])
    outward = chunk.point - middles[chunk.surface]
    assert ((outward * chunk.normal).sum(axis=1) > 0).all()
    assert np.allclose(np.linalg.norm(chunk.normal, axis=1), 1)


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_samples_stay_within_the_stated_bounds(name: str) -> None:
    model = BUILDERS[name](np.random.default_rng(3))
    surfaces = collect([without_hidden(model.shape)])
    counts = grids(surfaces, side_lengths(surfaces), np.full(len(surfaces.kind), 0.05))
    points = np.concatenate([chunk.point for chunk in sample(surfaces, counts, np.random.default_rng(0))])
    low, high = model.bounds
    assert (points > low - 1e-3).all()
    assert (points < high + 1e-3).all()
    assert np.isfinite(points).all()


@pytest.mark.parametrize("texture", list(Texture))
def test_textures_vary_about_one_within_their_contrast(texture: Texture) -> None:
    rng = np.random.default_rng(0)
    n = 4000
    point, normal = rng.uniform(-3, 3, (n, 3)), np.tile([0.0, 0.0, 1.0], (n, 1))
    factor = brightness(np.full(n, int(texture)), point, normal, np.full(n, 0.2), np.full(n, 0.1), np.full(n, 0.01))
    assert factor.std() > 0.005
    assert (np.abs(factor - 1) < 0.2).all()
    assert abs(factor.mean() - 1) < 0.08


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_highlights_add_legendre_lobes_about_the_normal(degree: int) -> None:
    rng = np.random.default_rng(degree)
    color, gloss = rng.uniform(0.2, 0.8, (50, 3)), rng.uniform(0, 0.2, 50)
    normal, toward = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 50, 3)))
    sh = to_sh(color, normal, gloss, degree)
    value = np.einsum("nk,nkc->nc", basis(degree, toward), sh) + 0.5
    cos = -(normal * toward).sum(axis=1)
    lobes = [cos, (3 * cos**2 - 1) / 2, (5 * cos**3 - 3 * cos) / 2]
    expected = sum((share * lobe for share, lobe in zip((1.0, 0.6, 0.3), lobes[:degree], strict=False)), np.zeros(50))
    assert np.allclose(value, color + (gloss * expected)[:, None], atol=1e-5)
    assert np.allclose(sh[:, 0] * C0 + 0.5, color, atol=1e-6)


@given(seed=st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_shortest_way_is_free_connected_and_never_longer_than_a_flood(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocked = np.pad(rng.random((14, 11)) < 0.25, 1, constant_values=True)
    cells = np.argwhere(~blocked)
    start = (int(cells[0][0]), int(cells[0][1]))
    goals = np.argwhere(flood(blocked, start))
    goal = (int(goals[-1][0]), int(goals[-1][1]))
    way = np.array(shortest(blocked, start, goal))
    assert tuple(way[0]) == start
    assert tuple(way[-1]) == goal
    assert not blocked[way[:, 0], way[:, 1]].any()
    assert (np.abs(np.diff(way, axis=0)).max(axis=1, initial=1) == 1).all()
