"""Stress cases of cameras, images and memory."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import Camera, look_at
from pipeline.render import render, render_reference
from pipeline.render.workspace import WORKSPACE
from tests.render.scenes import UP, camera, front_camera, gaussians, random_scene
from tests.render.stress_cases import Case, Outcome, image_case, rms

EYE = (3.0, 2.0, 1.0)


def lens(fx: float, fy: float, cx: float, cy: float) -> Camera:
    """A 96 x 64 camera 3.7 m from the middle of the scene."""
    return Camera(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), look_at(np.array(EYE), np.zeros(3), UP), 96, 64)


def far_away(offset: tuple[float, float, float]) -> Case:
    """A scene whose world coordinates are large; the camera is turned, so that nothing cancels by itself."""
    eye = np.array(offset) + EYE
    return image_case(
        f"world offset of {max(map(abs, offset)):.0e} m, rotated", "as near the origin",
        lambda: random_scene(6, offset=offset), lambda: camera(eye=eye, target=offset),
    )  # fmt: skip


def popping() -> Outcome:
    """Two crossed boards whose centres change order when the camera turns by a hundredth of a degree."""
    scene = gaussians(
        [[0.3, 0, 3.0], [-0.3, 0, 3.0]], scales=[[1.0, 0.5, 0.01]] * 2, opacity_logits=3.0,
        quats=[[np.cos(0.4), 0, np.sin(0.4), 0], [np.cos(0.4), 0, -np.sin(0.4), 0]], colors=[[1.0, 0, 0], [0, 1.0, 0]],
    )  # fmt: skip
    before, after = [], []
    worst = 0.0
    for side in (-1, 1):
        angle = side * np.radians(0.005)
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        view = front_camera(45, 39).moved_to(np.hstack([turn, np.zeros((3, 1))]))
        found, truth = render(scene, view), render_reference(scene, view)
        before.append(found.color)
        after.append(truth.color)
        worst = max(worst, rms(found, truth))
    ours, right = (float(np.abs(images[1] - images[0]).max()) for images in (before, after))
    return Outcome(ours, right, "float64", abs(ours - right), 1e-4, rms=worst)


def middle_of_8k() -> Outcome:
    """The middle of an 8K image is what a small camera with a moved principal point sees."""
    width, height, crop = 7680, 4320, 64
    scene = gaussians([[0.01, 0.005, 3.0], [0.0, -0.01, 3.2]], scales=[[0.004, 0.01, 0.01]] * 2)
    K = np.array([[6000.0, 0, width / 2], [0, 6000.0, height / 2], [0, 0, 1.0]])
    whole = render(scene, Camera(K, np.eye(3, 4), width, height), ("alpha",)).alpha
    top, left = (height - crop) // 2, (width - crop) // 2
    K = K - [[0, 0, left], [0, 0, top], [0, 0, 0]]
    right = render_reference(scene, Camera(K, np.eye(3, 4), crop, crop)).alpha
    ours = whole[top : top + crop, left : left + crop]
    return Outcome(float(ours.mean()), float(right.mean()), "float64", float(np.abs(ours - right).max()), 1e-5)


def many_pairs() -> Outcome:
    """70 layers over all 33 million pixels of an 8K image are 2.3e9 pairs: more than an int32 counts."""
    count, alpha, width, height = 70, 0.05, 7680, 4320
    means = np.column_stack([np.zeros((count, 2)), np.linspace(2.0, 9.0, count)])
    scene = gaussians(means, scales=1e6, opacity_logits=np.log(alpha / (1 - alpha)))
    assert count * width * height > 2**31
    K = np.array([[6000.0, 0, width / 2], [0, 6000.0, height / 2], [0, 0, 1.0]])
    found = render(scene, Camera(K, np.eye(3, 4), width, height), ("alpha",), threads=2).alpha
    right = 1 - (1 - alpha) ** count
    ours = float(found[np.abs(found - right).argmax() // width].mean())
    return Outcome(ours, right, "by hand", float(np.abs(found - right).max()), 1e-5)


def poisoned() -> Outcome:
    """Scratch memory full of not-a-numbers, large numbers or zeros gives the same bits."""
    scene, view = random_scene(6), camera(37, 21)
    truth = render_reference(scene, view)
    images, worst = [], 0.0
    for byte in (0x00, 0x7F, 0xC7, 0xFF):
        WORKSPACE.fill(byte)
        found = render(scene, view)
        images.append(np.dstack([found.color, found.depth, found.alpha, found.dominant, found.dominant_weight]))
        worst = max(worst, rms(found, truth))
    differing = float(sum((image != images[0]).sum() for image in images))
    return Outcome(differing, 0.0, "by hand", differing, 0.0, rms=worst)


VIEW_CASES: tuple[Case, ...] = (
    far_away((1e4, -1e4, 50.0)),
    far_away((1e5, 1e5, 1e5)),
    image_case(
        "principal point off the centre", "the clamp follows it", lambda: random_scene(5), lambda: lens(90, 60, 20, 50)
    ),
    image_case(
        "principal point outside the image",
        "the clamp follows it",
        lambda: random_scene(5),
        lambda: lens(60, 60, 130, 90),
    ),
    image_case("fx twice fy", "each axis has its own", lambda: random_scene(5), lambda: lens(120, 60, 48, 32)),
    image_case(
        "field of view of 170 degrees",
        "as the clamped Jacobian says",
        lambda: random_scene(5),
        lambda: lens(4.2, 4.2, 48, 32),
    ),
    image_case(
        "focal length of 1e5 px",
        "0.02 m at 1 km is 2 px wide",
        lambda: gaussians([[0, 0, 1000.0], [0.02, 0.01, 1001.0]], scales=0.02),
        lambda: front_camera(48, 32, focal=1e5),
    ),
    image_case("image of 1 x 1", "one pixel", lambda: random_scene(3), lambda: camera(1, 1)),
    image_case("image of 37 x 21", "no tile is whole", lambda: random_scene(3), lambda: camera(37, 21)),
    Case("image of 7680 x 4320", "its middle is what a small camera sees", middle_of_8k),
    Case("2.3e9 pixel pairs", "1 - 0.95^70 everywhere", many_pairs, slow=True),
    Case(
        "popping of crossed boards", "the order is by centre, so the image jumps: as in the reference, no more", popping
    ),
    Case("poisoned scratch memory", "no element differs", poisoned),
)
