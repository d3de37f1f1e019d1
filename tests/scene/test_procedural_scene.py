"""Built scenes: Gaussians, labels, boxes, views and what is seen from them."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from pipeline.construct.simulated.procedural_frames import rgbd_frames
from pipeline.geometry import look_at
from pipeline.render import prepare, render
from pipeline.scene.color_names import name_color
from pipeline.scene.procedural import VOCABULARY, ProceduralScene, build_apartment
from pipeline.scene.procedural.build import furnish
from pipeline.scene.procedural.walls import SIDES, openings
from schemas.errors import InputError

STRUCTURE = ("floor", "wall", "ceiling")
COUNT_TOLERANCE = 0.03
"""Grids come in whole rows and discs under flat things are dropped."""


@cache
def built(seed: int = 0, gaussians: int = 60_000) -> ProceduralScene:
    return build_apartment(seed, gaussians=gaussians, views=60, width=160, height=120)


def local_means(scene: ProceduralScene, instance: int) -> np.ndarray:
    """Gaussian centres of an instance in the frame of its box, metres."""
    thing = scene.objects[instance]
    means = scene.scene.gaussians.means[scene.scene.semantics.instance == instance] - np.array(thing.center)
    c, s = np.cos(thing.yaw), np.sin(thing.yaw)
    return np.stack([c * means[:, 0] + s * means[:, 1], -s * means[:, 0] + c * means[:, 1], means[:, 2]], axis=1)


@pytest.mark.parametrize("count", [25_000, 60_000, 250_000])
def test_gaussians_come_close_to_the_number_asked_for(count: int) -> None:
    scene = built(0, count).scene
    assert abs(len(scene.gaussians) / count - 1) < COUNT_TOLERANCE


@pytest.mark.slow
def test_five_million_gaussians_are_built() -> None:
    scene = build_apartment(3, rooms=8, gaussians=5_000_000, views=10).scene
    assert abs(len(scene.gaussians) / 5_000_000 - 1) < COUNT_TOLERANCE


def test_same_arguments_give_the_same_bits() -> None:
    a, b = (build_apartment(11, rooms=2, gaussians=20_000, views=12) for _ in range(2))
    for name in ("means", "quats", "log_scales", "opacity_logits", "sh"):
        assert np.array_equal(getattr(a.scene.gaussians, name), getattr(b.scene.gaussians, name))
    one, two = a.scene.semantics.instance, b.scene.semantics.instance
    assert one is not None
    assert two is not None
    assert np.array_equal(one, two)
    assert a.objects == b.objects
    for view, same in zip(a.scene.views, b.scene.views, strict=True):
        assert np.array_equal(view.camera.world_to_camera, same.camera.world_to_camera)


def test_number_of_gaussians_changes_neither_contents_nor_views() -> None:
    few, many = built(0, 25_000), built(0, 60_000)
    assert few.objects == many.objects
    for one, two in zip(few.scene.views, many.scene.views, strict=True):
        assert np.array_equal(one.camera.world_to_camera, two.camera.world_to_camera)


def test_labels_agree_with_objects_and_every_object_has_gaussians() -> None:
    scene = built()
    semantics = scene.scene.semantics
    assert semantics.vocabulary == VOCABULARY
    assert semantics.category is not None
    assert semantics.instance is not None
    expected = np.array([VOCABULARY.index(thing.category) for thing in scene.objects])
    assert np.array_equal(semantics.category, expected[semantics.instance])
    counts = np.bincount(semantics.instance, minlength=len(scene.objects))
    assert [thing.instance for thing in scene.objects] == list(range(len(scene.objects)))
    assert counts.min() >= 8
    assert len(semantics.present()) < len(VOCABULARY)


def test_boxes_are_tight() -> None:
    scene = built(0, 250_000)
    for thing in scene.objects:
        if thing.category in STRUCTURE:
            continue
        local, half = local_means(scene, thing.instance), np.array(thing.half_extents)
        assert (np.abs(local) < half + 1e-3).all(), thing.category
        # Discs keep off edges and silhouettes by a share of their spacing.
        slack = np.maximum(0.12 * half, 0.035)
        assert (local.max(axis=0) > half - slack).all(), thing.category
        assert (local.min(axis=0) < -half + slack).all(), thing.category


def test_discs_are_flat_opaque_and_mildly_view_dependent() -> None:
    gaussians = built().scene.gaussians
    scales = np.exp(gaussians.log_scales)
    assert (scales[:, 2] < 0.5 * scales[:, :2].min(axis=1)).all()
    opacity = 1 / (1 + np.exp(-gaussians.opacity_logits))
    assert opacity.min() >= 0.95
    assert gaussians.sh_degree == 1
    lobe = np.abs(gaussians.sh[:, 1:]).max()
    assert 0 < lobe < 0.5
    assert build_apartment(0, rooms=1, gaussians=20_000, views=1, sh_degree=3).scene.gaussians.sh_degree == 3


@pytest.mark.parametrize("seed", [0, 1])
def test_surfaces_are_closed_wherever_the_person_looks(seed: int) -> None:
    scene = built(seed).scene
    prepared = prepare(scene.gaussians)
    open_share = []
    for view in scene.views[::4]:
        alpha = render(prepared, view.camera, ("alpha",)).alpha
        assert alpha is not None
        assert np.median(alpha) > 0.98
        open_share.append(float((alpha < 0.8).mean()))
    assert max(open_share) < 0.02
    assert np.mean(open_share) < 0.002


def test_walls_without_doorways_hide_what_is_behind_them() -> None:
    scene = built(1)
    layout = furnish(4, np.random.default_rng([1, 0])).layout
    instance, prepared = scene.scene.semantics.instance, prepare(scene.scene.gaussians)
    assert instance is not None
    rooms = np.array([thing.room for thing in scene.objects])
    looked = 0
    for number, room in enumerate(layout.rooms):
        for side in SIDES:
            if openings(layout, number, side):
                continue
            target = np.array([*room.center, 1.3])
            target[side.axis] = side.plane(room)
            eye = target.copy()
            eye[side.axis] += 1.2 * side.inward
            camera = scene.scene.views[0].camera.moved_to(look_at(eye, target, np.array([0.0, 0.0, 1.0])))
            dominant = render(prepared, camera, ("dominant",)).dominant
            assert dominant is not None
            seen = instance[dominant[dominant >= 0]]
            assert (rooms[seen] != room.name).mean() < 0.002, (room.name, side.name)
            looked += 1
    assert looked >= 6


@pytest.mark.parametrize(("seed", "rooms"), [(0, 2), (5, 5)])
def test_walk_visits_every_room_at_eye_height_and_touches_nothing(seed: int, rooms: int) -> None:
    scene = build_apartment(seed, rooms=rooms, gaussians=50_000, views=150)
    centers = np.array([view.camera.center for view in scene.scene.views])
    assert ((centers[:, 2] > 1.5) & (centers[:, 2] < 1.6)).all()
    visited = {r.name for r in scene.rooms for x, y, _ in centers if r.contains(float(x), float(y))}
    assert visited == {room.name for room in scene.rooms}
    means = scene.scene.gaussians.means
    nearest = [float(np.linalg.norm(means - center, axis=1).min()) for center in centers]
    assert min(nearest) > 0.15
    assert [view.name for view in scene.scene.views[:2]] == ["00000", "00001"]
    steps = np.linalg.norm(np.diff(centers, axis=0), axis=1)
    assert steps.max() < 1.0


def test_most_things_are_seen_somewhere_and_few_are_seen_whole() -> None:
    scene = built(1)
    instance, prepared = scene.scene.semantics.instance, prepare(scene.scene.gaussians)
    assert instance is not None
    pixels = np.zeros(len(scene.objects), int)
    for view in scene.scene.views:
        dominant = render(prepared, view.camera, ("dominant",)).dominant
        assert dominant is not None
        pixels = np.maximum(pixels, np.bincount(instance[dominant[dominant >= 0]], minlength=len(pixels)))
    things = [thing for thing in scene.objects if thing.category not in STRUCTURE]
    seen = np.array([pixels[thing.instance] >= 6 for thing in things])
    hidden = np.array([thing.relation in ("in", "under", "behind") for thing in things])
    assert seen.mean() > 0.75
    assert 0.2 < seen[hidden].mean() < seen[~hidden].mean()


def test_rendered_colors_carry_the_names_in_the_objects() -> None:
    scene = built(0, 250_000)
    instance = scene.scene.semantics.instance
    dc = scene.scene.gaussians.sh[:, 0] * 0.28209479177387814 + 0.5
    right = []
    for thing in scene.objects:
        if thing.color and thing.category not in ("mirror",):
            right.append(
                name_color(np.median(dc[instance == thing.instance], axis=0).astype(np.float64)) == thing.color
            )
    assert len(right) > 100
    assert np.mean(right) > 0.95


def test_frames_have_color_and_metric_depth() -> None:
    scene = built().scene
    frames = list(rgbd_frames(scene, scene.views[:3]))
    assert len(frames) == 3
    for color, depth in frames:
        assert color.shape == (120, 160, 3)
        assert color.dtype == np.uint8
        assert color.std() > 5
        assert depth.dtype == np.float32
        assert 0.2 < np.median(depth) < 10
    assert len(list(rgbd_frames(dataclasses.replace(scene, views=scene.views[:5])))) == 5


@pytest.mark.parametrize(
    ("field", "value"),
    [("rooms", 0), ("rooms", 25), ("gaussians", 10), ("views", 0), ("width", 0), ("sh_degree", 4)],
)
def test_bad_arguments_are_named(field: str, value: int) -> None:
    with pytest.raises(InputError, match=field):
        build_apartment(0, **{field: value})


def test_too_few_gaussians_for_a_large_apartment_says_how_many_it_takes() -> None:
    with pytest.raises(InputError, match="at least"):
        build_apartment(0, rooms=6, gaussians=5_000, views=1)
