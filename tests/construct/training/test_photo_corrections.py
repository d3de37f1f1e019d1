from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry import look_at
from tests.construct import tiny_capture

torch = pytest.importorskip("torch")

from pipeline.construct.photos.camera_motion import moved  # noqa: E402
from pipeline.construct.training.photo_corrections import PhotoCorrections, pose_gradient  # noqa: E402
from pipeline.construct.training.rasterizer import rasterize_seen  # noqa: E402
from pipeline.construct.training.train_config import TrainConfig  # noqa: E402
from pipeline.construct.training.train_state import PARAMETERS, TrainState  # noqa: E402

CAMERA = tiny_capture.cameras(3)[0]


def test_no_motion_leaves_the_camera_where_it_is() -> None:
    assert np.array_equal(moved(CAMERA, np.zeros(6)).world_to_camera, CAMERA.world_to_camera)


def test_a_motion_is_made_in_the_cameras_own_axes() -> None:
    twist = np.array([0.1, 0.0, 0.0, 0.0, np.pi / 2, 0.0])
    points = np.array([[0.2, -0.1, 0.3]])
    local = points @ CAMERA.world_to_camera[:, :3].T + CAMERA.world_to_camera[:, 3]
    after = points @ moved(CAMERA, twist).world_to_camera[:, :3].T + moved(CAMERA, twist).world_to_camera[:, 3]
    assert after[0] == pytest.approx([local[0, 2] + 0.1, local[0, 1], -local[0, 0]])


def test_pose_gradient_meets_finite_differences() -> None:
    truth = tiny_capture.truth(25)
    state = TrainState.of(truth, sh_degree=0)
    values = [state.values[name] for name in PARAMETERS]
    weights = torch.from_numpy(np.random.default_rng(0).normal(size=(CAMERA.height, CAMERA.width, 3)))
    # Smooth weights: the loss would otherwise hang on single pixels near the cut at 1/255.
    weights = torch.nn.functional.avg_pool2d(weights.permute(2, 0, 1)[None], 9, 1, 4)[0].permute(1, 2, 0).float()

    def loss(twist: np.ndarray) -> float:
        raster = rasterize_seen(*values, moved(CAMERA, twist), outputs=("color",))
        return float((raster.color.detach().double() * weights).sum())

    raster = rasterize_seen(*values, CAMERA, outputs=("color",))
    (raster.color * weights).sum().backward()
    found = raster.seen_gradients()
    rows = (values[0][found.ids], values[1][found.ids])
    gradient = pose_gradient(CAMERA, *rows, found.means, found.quats).numpy()
    step = 2e-3
    numeric = [(loss(step * axis) - loss(-step * axis)) / (2 * step) for axis in np.eye(6)]
    assert gradient == pytest.approx(numeric, rel=0.05, abs=0.02 * float(np.abs(numeric).max()))


def test_corrections_are_fitted_where_asked_and_centred_on_nothing() -> None:
    corrections = PhotoCorrections(3, TrainConfig(exposure=True, refine_poses=True))
    exposure = corrections.exposure(1)
    assert exposure is not None
    exposure.grad = torch.ones(2, 3)
    corrections.step(1, exposure, torch.tensor([1.0, 0, 0, 0, 0, -1.0]))
    rates = TrainConfig().rates
    found = corrections.exposure(1)
    assert found is not None
    assert found.detach().numpy() == pytest.approx(-rates.exposures)
    camera = corrections.camera(1, CAMERA)
    assert camera.world_to_camera == pytest.approx(
        moved(CAMERA, np.array([-rates.poses, 0, 0, 0, 0, rates.poses])).world_to_camera, abs=1e-7
    )
    corrections.center()
    others = [corrections.exposure(k).detach().numpy() for k in range(3)]  # type: ignore[union-attr]
    assert np.sum(others, axis=0) == pytest.approx(0.0, abs=1e-8)
    assert others[0] == pytest.approx(rates.exposures / 3)
    again = PhotoCorrections(3, TrainConfig(exposure=True, refine_poses=True))
    again.restore(corrections.arrays())
    assert np.array_equal(again.camera(2, CAMERA).world_to_camera, corrections.camera(2, CAMERA).world_to_camera)


def test_without_being_asked_nothing_is_corrected() -> None:
    corrections = PhotoCorrections(2, TrainConfig())
    assert corrections.exposure(0) is None
    assert corrections.camera(0, CAMERA) is CAMERA


def test_look_at_cameras_stay_rigid_when_moved() -> None:
    camera = CAMERA.moved_to(look_at(np.array([1.0, 2, 3]), np.zeros(3), np.array([0, 0, 1.0])))
    rotation = moved(camera, np.array([0, 0, 0, 0.3, -0.2, 0.5])).world_to_camera[:, :3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
