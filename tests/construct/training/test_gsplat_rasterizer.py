"""The gsplat adapter, without a GPU: a stand-in blends what gsplat is handed as gsplat documents it, densely."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from schemas.errors import InputError
from tests.render.scenes import camera, random_scene

torch = pytest.importorskip("torch", reason="torch is in the extra build")

from pipeline.construct.training import gsplat_rasterizer, rasterizer  # noqa: E402
from pipeline.geometry import Camera  # noqa: E402
from tests.construct.torch_reference import blend_dense, harmonics_dense  # noqa: E402
from tests.construct.training.test_rasterizer import BACKGROUND, NAMES, OUTPUTS, image_weights, loss_of, parameters  # noqa: E402

LARGEST_DIFFERENCE = 1e-4
"""Between two float32 computations, as a share of the largest gradient of its kind."""


def dense_rasterization(
    means, quats, scales, opacities, colors, viewmats, Ks, width, height, *,
    near_plane, eps2d, packed, backgrounds,
):  # fmt: skip
    """gsplat.rasterization for one camera and any number of channels, its documented arguments and results."""
    assert eps2d == 0.3
    assert not packed
    view = Camera(Ks[0].numpy().astype(np.float64), viewmats[0, :3].double().numpy(), width, height)
    blended = blend_dense(means, quats, scales, opacities, view, near=near_plane)
    means_px = torch.zeros(1, len(means), 2).index_copy(1, blended.ids, blended.means_px[None].float())
    # The graph must run through the returned means, as gsplat's does.
    shift = (means_px[0, blended.ids] - blended.means_px).detach()
    assert float(shift.abs().max()) < 1e-3
    images = blended.weights.T @ colors[blended.ids] + (1 - blended.weights.sum(0))[:, None] * backgrounds[0]
    radii = torch.zeros(1, len(means), 2, dtype=torch.int32)
    radii[0, blended.ids[(blended.weights > 0).any(1)]] = 5
    size = (1, height, width, -1)
    return images.reshape(size), blended.weights.sum(0).reshape(size), {"means2d": means_px, "radii": radii}


@pytest.fixture
def _stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    module = SimpleNamespace(rasterization=dense_rasterization, spherical_harmonics=harmonics_dense)
    monkeypatch.setitem(sys.modules, "gsplat", module)


@pytest.mark.usefixtures("_stand_in")
@pytest.mark.parametrize("outputs", [OUTPUTS, ("color",), ("inverse_depth",)])
def test_images_and_gradients_are_those_of_the_cpu(outputs: tuple[str, ...]) -> None:
    scene, view = random_scene(1, 60, sh_degree=2), camera(33, 23, focal=28.0)
    weights, found = image_weights(view), []
    for module in (rasterizer, gsplat_rasterizer):
        raster = module.rasterize_seen(
            *parameters(scene), view, sh_degree=1, background=BACKGROUND, outputs=outputs,
            tiles=np.array([[True, False, True], [False, True, True]]),
        )  # fmt: skip
        loss_of(raster, weights, outputs).backward()
        found.append((raster, raster.seen_gradients()))
    (ours, truth), (theirs, gradients) = found
    for name in OUTPUTS:
        if name not in outputs:
            assert getattr(theirs, name) is None
            continue
        one, other = (getattr(raster, name).detach().numpy() for raster in (ours, theirs))
        np.testing.assert_allclose(other, one, atol=1e-4)
    assert set(theirs.seen.tolist()) <= set(ours.seen.tolist())
    for name in NAMES:
        one, other = (np.zeros((60, *getattr(g, name).shape[1:])) for g in (truth, gradients))
        one[truth.ids], other[gradients.ids] = getattr(truth, name), getattr(gradients, name)
        np.testing.assert_allclose(other, one, atol=LARGEST_DIFFERENCE * np.abs(one).max() + 1e-12, err_msg=name)


@pytest.mark.usefixtures("_stand_in")
def test_gradients_are_asked_for_once_and_after_backward() -> None:
    raster = gsplat_rasterizer.rasterize_seen(*parameters(random_scene(2, 10)), camera(20, 20))
    with pytest.raises(ValueError, match="no gradient has reached"):
        raster.seen_gradients()
    raster.color.sum().backward()
    raster.seen_gradients()
    with pytest.raises(ValueError, match="given back"):
        raster.seen_gradients()


def test_without_gsplat_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(InputError, match="gpu"):
        gsplat_rasterizer.rasterize_seen(*parameters(random_scene(2, 10)), camera(20, 20))
