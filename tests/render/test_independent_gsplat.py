"""The float64 reference against gsplat's own PyTorch functions, where gsplat is installed: projection and colours.

    pip install -c constraints.txt -e '.[dev,peers]'        # its CUDA code is never built here

Both run in float64 on a CPU, so that only a difference in meaning could show.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry import Camera, look_at
from pipeline.render.lens import Lens
from pipeline.render.reference import project_float64, sh_colors
from tests.render.scenes import UP, camera, random_scene

torch = pytest.importorskip("torch", reason="torch is not installed")
gsplat = pytest.importorskip("gsplat.cuda._torch_impl", reason="gsplat is not installed: it is in the extra peers")

LARGEST_RELATIVE = 1e-9
"""gsplat multiplies the covariance out and subtracts for the determinant: some digits are its own loss."""

VIEWS = {
    "plain": camera(),
    "telephoto": camera(focal=900.0),
    "wide": camera(focal=20.0),
    "principal point off the centre": Camera(
        np.array([[90.0, 0, 20.0], [0, 60.0, 50.0], [0, 0, 1]]), look_at(np.array([3.0, 2, 1]), np.zeros(3), UP), 96, 64
    ),
}


def _double(array: np.ndarray):
    return torch.from_numpy(np.array(array, np.float64))


@pytest.mark.parametrize("name", VIEWS)
@pytest.mark.parametrize("antialias", [False, True])
def test_projection_equals_gsplats(name: str, antialias: bool) -> None:
    scene, view, near = random_scene(21, 500), VIEWS[name], 0.2
    covariances, _ = gsplat._quat_scale_to_covar_preci(
        torch.nn.functional.normalize(_double(scene.quats), dim=-1), torch.exp(_double(scene.log_scales)), True, False
    )
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3] = _double(view.world_to_camera)
    _, centers, depths, conics, compensations = gsplat._fully_fused_projection(
        _double(scene.means), covariances, pose[None], _double(view.K)[None], view.width, view.height,
        near_plane=near, calc_compensations=True,
    )  # fmt: skip
    ours = project_float64(scene, view, near, antialias)
    assert len(ours.ids) > 300
    assert set(ours.ids) == set(np.flatnonzero(depths[0].numpy() > near))
    np.testing.assert_allclose(ours.centers, centers[0].numpy()[ours.ids], rtol=1e-9, atol=1e-7)
    scale = np.abs(ours.conics).max(axis=1, keepdims=True)
    np.testing.assert_allclose(ours.conics / scale, conics[0].numpy()[ours.ids] / scale, atol=LARGEST_RELATIVE)
    np.testing.assert_allclose(ours.depths, depths[0].numpy()[ours.ids], rtol=1e-6)  # ours are rounded to float32
    opacities = torch.sigmoid(_double(scene.opacity_logits)).numpy()[ours.ids]
    if antialias:
        # Below 0.005 the two differ by design: gsplat has no floor of 2.5e-5 under the ratio.
        opacities = opacities * np.maximum(0.005, compensations[0].numpy()[ours.ids])
    np.testing.assert_allclose(ours.opacities, opacities, rtol=1e-6)


@pytest.mark.parametrize("degree", range(4))
def test_colors_equal_gsplats(degree: int) -> None:
    scene, view = random_scene(22, 300, sh_degree=3), camera()
    center, ids = Lens.of(view).center, np.arange(300)
    sums = gsplat._spherical_harmonics(degree, _double(scene.means) - _double(center), _double(scene.sh))
    expected = np.maximum(0.0, sums.numpy() + 0.5)
    np.testing.assert_allclose(sh_colors(scene, center, ids, degree), expected, rtol=1e-9, atol=1e-12)
