"""Gradients of the CPU rasteriser: against finite differences in float64, a dense PyTorch renderer, and their laws."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pipeline.geometry import Camera, look_at
from pipeline.render import render, render_reference
from pipeline.render.workspace import WORKSPACE
from pipeline.scene.gaussians import Gaussians
from schemas.errors import InputError
from tests.render.scenes import UP, camera, front_camera, gaussians, random_scene

torch = pytest.importorskip("torch", reason="torch is in the extra build")

from pipeline.construct.training.rasterizer import OUTPUTS, rasterize, rasterize_seen  # noqa: E402
from tests.construct.torch_reference import render_dense  # noqa: E402

NAMES = ("means", "quats", "log_scales", "opacity_logits", "sh")
BACKGROUND = (0.1, 0.25, 0.4)
LARGEST_DIFFERENCE = 2e-5
"""Between float32 kernels and float64, as a share of the largest gradient of its kind; 1e-6 to 3e-6 is usual."""
LARGEST_ROW_DIFFERENCE = 2e-3
"""Of one Gaussian, as a share of its own gradient, or of 1/1000 of the largest where that is more."""
STEP = 1e-5
"""Half the distance of two images in a finite difference: its error is some 1e-9 of the gradient, so is rounding's."""
LARGEST_STEP_DIFFERENCE = 1e-6
"""Between float64's gradient and finite differences, as a share of the largest; both errors above with room."""

OFF_CENTRE = Camera(
    np.array([[40.0, 0, 8.0], [0, 30.0, 17.0], [0, 0, 1]]), look_at(np.array([2.5, 2, 1]), np.zeros(3), UP), 29, 19
)
CAMERAS = {
    "plain": camera(33, 23, focal=28.0),
    "wide: many beyond the Jacobian's clamp": camera(25, 17, focal=6.0, eye=(1.5, 1.0, 0.5)),
    "inside: many behind and beside": camera(24, 24, focal=18.0, eye=(0.2, 0.1, 0.0), target=(1.0, 0.5, 0.0)),
    "telephoto": camera(27, 17, focal=200.0),
    "principal point off the centre": OFF_CENTRE,
}


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Tiny tensors: PyTorch's own threads would only wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def parameters(scene: Gaussians, dtype=torch.float32) -> list[torch.Tensor]:
    return [torch.tensor(np.array(getattr(scene, name)), dtype=dtype).requires_grad_() for name in NAMES]


def image_weights(view: Camera, seed: int = 0) -> dict[str, torch.Tensor]:
    """One random weight per number of every image: the loss is their sum, so every pixel pulls another way."""
    rng = np.random.default_rng(seed)
    size = (view.height, view.width)
    return {name: torch.tensor(rng.normal(size=(*size, 3) if name == "color" else size)) for name in OUTPUTS}


def loss_of(images, weights: dict[str, torch.Tensor], names=OUTPUTS) -> torch.Tensor:
    return sum((getattr(images, name).double() * weights[name]).sum() for name in names)


def true_gradients(scene: Gaussians, view: Camera, weights, names=OUTPUTS, **options) -> list[np.ndarray]:
    raw = parameters(scene, torch.float64)
    loss = loss_of(render_dense(*raw, view, background=BACKGROUND, **options), weights, names)
    return [g.numpy() for g in torch.autograd.grad(loss, raw)]


def our_gradients(scene: Gaussians, view: Camera, weights, names=OUTPUTS, **options) -> list[np.ndarray]:
    raw = parameters(scene)
    loss_of(rasterize(*raw, view, background=BACKGROUND, outputs=names, **options), weights, names).backward()
    return [p.grad.numpy() for p in raw]


def assert_gradients_match(found: list[np.ndarray], truth: list[np.ndarray]) -> None:
    for name, ours, true in zip(NAMES, found, truth, strict=True):
        ours, true = (a.reshape(len(a), int(np.prod(a.shape[1:]))).astype(np.float64) for a in (ours, true))
        error, largest = np.abs(ours - true).max(axis=1, initial=0), np.abs(true).max(initial=0)
        assert error.max(initial=0) <= LARGEST_DIFFERENCE * largest, name
        own = np.maximum(np.abs(true).max(axis=1, initial=0), 1e-3 * largest)
        assert np.all(error <= LARGEST_ROW_DIFFERENCE * own), name


def mixed_scene(seed: int, degree: int = 3) -> Gaussians:
    """Random Gaussians, some capped (opacity next to 1), some far smaller than a pixel, some next to 1/255, flat."""
    scene = random_scene(seed, 60, sh_degree=degree)
    logits, log_scales = scene.opacity_logits.copy(), scene.log_scales.copy()
    logits[:12], logits[12:20] = 7.0, -4.5
    log_scales[20:30] = np.log(0.002)
    log_scales[30:40, 1] = np.log(1e-4)
    return replace(scene, opacity_logits=logits, log_scales=log_scales)


def steps_match(scene: Gaussians, view: Camera, output: str, seed: int) -> None:
    """Hold autograd's slope along a random direction of each parameter to the difference of two images."""
    weights, raw = image_weights(view), parameters(scene, torch.float64)
    images = render_dense(*raw, view, background=BACKGROUND)
    rng, names = np.random.default_rng(seed), OUTPUTS if output == "all" else (output,)
    for k, name in enumerate(NAMES):
        direction = torch.tensor(rng.normal(size=raw[k].shape))
        with torch.no_grad():
            ends = [
                render_dense(
                    *(p + step * direction if j == k else p for j, p in enumerate(raw)), view, background=BACKGROUND
                )
                for step in (STEP, -STEP)
            ]
        # A pixel where a contribution came or went has jumped: it has no finite difference.
        assert all(torch.equal(end.ids, images.ids) for end in ends)
        same = torch.stack([(end.contributions == images.contributions).all(0) for end in ends]).all(0)
        assert same.double().mean() > 0.9
        kept = {n: w * same.reshape(images.alpha.shape + (1,) * (w.ndim - 2)) for n, w in weights.items()}
        slope = float(loss_of(ends[0], kept, names) - loss_of(ends[1], kept, names)) / (2 * STEP)
        (gradient,) = torch.autograd.grad(
            loss_of(images, kept, names), raw[k], retain_graph=True, materialize_grads=True
        )
        found, scale = float((gradient * direction).sum()), float(gradient.norm())
        assert found == pytest.approx(slope, abs=LARGEST_STEP_DIFFERENCE * scale + 1e-9), name


class TestReference:
    """The dense renderer's own gradient is right: autograd meets finite differences, all in float64."""

    @pytest.mark.parametrize("view", CAMERAS.values(), ids=CAMERAS.keys())
    def test_autograd_equals_finite_differences_in_every_view(self, view: Camera) -> None:
        steps_match(mixed_scene(1), view, "all", 2)

    @pytest.mark.parametrize("output", OUTPUTS)
    def test_autograd_equals_finite_differences_of_every_image(self, output: str) -> None:
        steps_match(mixed_scene(2), CAMERAS["plain"], output, 3)

    def test_images_are_those_of_the_numpy_reference(self) -> None:
        scene, view = random_scene(3, 200, sh_degree=3), CAMERAS["plain"]
        found = render_dense(*parameters(scene, torch.float64), view, background=BACKGROUND)
        truth = render_reference(scene, view, ("color", "depth", "alpha"), background=BACKGROUND)
        np.testing.assert_allclose(found.color.detach(), truth.color, atol=1e-6)
        np.testing.assert_allclose(found.depth.detach(), truth.depth * truth.alpha, atol=1e-5)


class TestGradients:
    """The kernels' gradient meets float64's."""

    @pytest.mark.parametrize("view", CAMERAS.values(), ids=CAMERAS.keys())
    @pytest.mark.parametrize("seed", [1, 2])
    def test_all_images_of_mixed_gaussians(self, view: Camera, seed: int) -> None:
        scene, weights = mixed_scene(seed), image_weights(view)
        assert_gradients_match(our_gradients(scene, view, weights), true_gradients(scene, view, weights))

    @pytest.mark.parametrize("output", OUTPUTS)
    @pytest.mark.parametrize("degree", [0, 1, 2, 3])
    def test_each_image_and_degree(self, output: str, degree: int) -> None:
        scene, view = mixed_scene(3), CAMERAS["plain"]
        weights = image_weights(view)
        found = our_gradients(scene, view, weights, (output,), sh_degree=degree)
        raw = parameters(scene, torch.float64)
        images = render_dense(*raw, view, background=BACKGROUND, sh_degree=degree)
        loss = loss_of(images, weights, (output,))
        truth = torch.autograd.grad(loss, raw, materialize_grads=True)
        assert_gradients_match(found, [g.numpy() for g in truth])
        assert not found[4][:, (degree + 1) ** 2 :].any()

    def test_pixels_that_stop_at_different_depths(self) -> None:
        scene, view = random_scene(21, 200, sh_degree=1), CAMERAS["plain"]
        scene = replace(scene, opacity_logits=scene.opacity_logits + np.float32(4), log_scales=scene.log_scales * 0.6)
        weights = image_weights(view)
        images = render_dense(*parameters(scene, torch.float64), view)
        stopped = (images.alpha > 0.999).double().mean()
        assert 0.3 < stopped < 0.98
        assert_gradients_match(our_gradients(scene, view, weights), true_gradients(scene, view, weights))

    def test_finite_differences_of_a_small_scene(self) -> None:
        """Every single parameter, by two images in float64: no other gradient is involved."""
        scene, view = random_scene(8, 5, sh_degree=2), camera(17, 13, focal=14.0)
        weights = image_weights(view)
        found = our_gradients(scene, view, weights)
        raw = [p.detach() for p in parameters(scene, torch.float64)]
        with torch.no_grad():
            for k, name in enumerate(NAMES):
                slopes = np.empty(raw[k].numel())
                for j in range(raw[k].numel()):
                    ends = []
                    for sign in (STEP, -STEP):
                        moved = [p.clone() for p in raw]
                        moved[k].view(-1)[j] += sign
                        ends.append(loss_of(render_dense(*moved, view, background=BACKGROUND), weights))
                    slopes[j] = float(ends[0] - ends[1]) / (2 * STEP)
                largest = np.abs(slopes).max()
                np.testing.assert_allclose(found[k].reshape(-1), slopes, atol=3e-5 * largest, err_msg=name)

    @settings(max_examples=8, deadline=None)
    @given(st.integers(0, 10**6), st.integers(1, 300), st.integers(1, 40), st.integers(1, 40), st.integers(0, 3))
    def test_any_scene(self, seed: int, count: int, width: int, height: int, degree: int) -> None:
        scene, view = random_scene(seed, count, sh_degree=degree), camera(width, height, focal=0.8 * width + 5)
        weights = image_weights(view, seed)
        images = render_dense(*parameters(scene, torch.float64), view)
        found = rasterize(*parameters(scene), view, outputs=("alpha",)).alpha
        # Left out: a contribution next to 1/255 or a stop next to 1e-4 that fell the other way in float32.
        assume((found.double() - images.alpha).abs().max() < 1e-5)
        assert_gradients_match(our_gradients(scene, view, weights), true_gradients(scene, view, weights))

    def test_screen_norm_is_the_pull_at_projected_means(self) -> None:
        scene, view = mixed_scene(4), CAMERAS["plain"]
        weights, raw = image_weights(view), parameters(mixed_scene(4), torch.float64)
        images = render_dense(*raw, view)
        images.means_px.retain_grad()
        loss_of(images, weights).backward()
        norms = np.zeros(len(scene))
        norms[images.ids] = np.hypot(*(images.means_px.grad.numpy() * [view.width / 2, view.height / 2]).T)
        raster = rasterize(*parameters(scene), view, outputs=OUTPUTS)
        loss_of(raster, weights).backward()
        np.testing.assert_allclose(raster.screen.norm, norms[raster.seen], atol=LARGEST_DIFFERENCE * norms.max())

    def test_capped_alpha_does_not_pull_at_the_opacity(self) -> None:
        """One Gaussian much larger than the image and capped everywhere: the image does not change with it."""
        scene = gaussians([[0.0, 0.0, 2.0]], scales=50.0, opacity_logits=9.0)
        weights = image_weights(front_camera(9, 9))
        found = our_gradients(scene, front_camera(9, 9), weights)
        assert not found[3].any()
        assert not found[2].any()
        assert found[4].any()

    def test_black_channels_do_not_pull_at_their_coefficients(self) -> None:
        scene = gaussians([[0.0, 0.0, 2.0]], colors=(-0.5, 0.5, 0.5))
        found = our_gradients(scene, front_camera(), image_weights(front_camera()), ("color",))
        assert not found[4][0, :, 0].any()
        assert found[4][0, :, 1:].all()


class TestImages:
    def test_images_are_those_of_render(self) -> None:
        scene, view = random_scene(5, 2000, sh_degree=3), camera(150, 100, focal=120.0)
        found = rasterize(*parameters(scene), view, background=BACKGROUND, outputs=OUTPUTS)
        truth = render(scene, view, ("color", "depth", "alpha"), background=BACKGROUND)
        np.testing.assert_allclose(found.color.detach(), truth.color, atol=1e-5)
        np.testing.assert_allclose(found.alpha.detach(), truth.alpha, atol=1e-5)
        np.testing.assert_allclose(found.depth.detach(), truth.depth * truth.alpha, atol=1e-4)

    def test_inverse_depth_of_an_opaque_wall(self) -> None:
        scene = gaussians(
            [[0.0, 0.0, 4.0], [0.0, 0.0, 4.0], [0.0, 0.0, 4.0]], scales=(9.0, 9.0, 1e-4), opacity_logits=9
        )
        found = rasterize(*parameters(scene), front_camera(8, 8))
        np.testing.assert_allclose(found.inverse_depth.detach(), found.alpha.detach() / 4, rtol=1e-5)

    def test_radius_is_three_deviations_of_the_longer_axis(self) -> None:
        scene = gaussians([[0.0, 0.0, 4.0]], scales=(0.5, 0.1, 0.1))
        raster = rasterize_seen(*parameters(scene), front_camera())
        assert float(raster.radius_px[0]) == pytest.approx(3 * np.sqrt((40 * 0.5 / 4) ** 2 + 0.3), rel=1e-5)


class TestLaws:
    def test_same_bits_at_any_thread_count_and_whatever_memory_held(self) -> None:
        scene, view = random_scene(6, 5000, sh_degree=1), camera(200, 130, focal=150.0)
        weights = image_weights(view)
        truth = our_gradients(scene, view, weights, threads=1)
        for threads in (1, 2, 3, 7):
            WORKSPACE.fill(0xFF)
            for name, one, other in zip(
                NAMES, truth, our_gradients(scene, view, weights, threads=threads), strict=True
            ):
                np.testing.assert_array_equal(one, other, err_msg=f"{name}, {threads} threads")

    def test_many_slabs_give_the_gradients_of_one(self, monkeypatch: pytest.MonkeyPatch) -> None:
        scene, view = random_scene(7, 3000, sh_degree=1), camera(90, 70, focal=80.0)
        weights = image_weights(view)
        truth = our_gradients(scene, view, weights)
        monkeypatch.setattr("pipeline.render.passes.SLAB_KEYS_PER_TILE", 1)
        monkeypatch.setattr("pipeline.render.passes.SMALLEST_SLAB", 16)
        for name, one, other in zip(NAMES, truth, our_gradients(scene, view, weights), strict=True):
            np.testing.assert_allclose(other, one, atol=1e-6 * np.abs(one).max(), err_msg=name)

    def test_seen_rows_are_the_dense_gradient_and_all_else_is_zero(self) -> None:
        scene, view = random_scene(9, 400, sh_degree=2), CAMERAS["inside: many behind and beside"]
        weights = image_weights(view)
        dense = our_gradients(scene, view, weights, sh_degree=1)
        raster = rasterize_seen(*parameters(scene), view, background=BACKGROUND, outputs=OUTPUTS, sh_degree=1)
        loss_of(raster, weights).backward()
        found = raster.seen_gradients()
        assert 10 < len(found.ids) < 350
        assert found.sh.shape == (len(found.ids), 4, 3)
        for name, whole in zip(NAMES, dense, strict=True):
            rows = getattr(found, name).numpy()
            np.testing.assert_array_equal(
                whole[found.ids][:, : rows.shape[1]] if name == "sh" else whole[found.ids], rows
            )
            unseen = np.ones(len(scene), bool)
            unseen[found.ids] = False
            assert not whole[unseen].any()

    def test_gaussians_hidden_behind_opaque_ones_are_not_seen(self) -> None:
        front = [[0.0, 0.0, 2.0 + 0.01 * k] for k in range(4)]
        scene = gaussians([*front, [0.0, 0.0, 5.0]], scales=30.0, opacity_logits=9.0)
        view = front_camera()
        weights = image_weights(view)
        assert not our_gradients(scene, view, weights)[0][4].any()

    def test_tiles_left_out_count_as_tiles_without_gradient(self) -> None:
        scene, view = random_scene(10, 300), camera(70, 50, focal=50.0)
        weights, tiles = image_weights(view), np.random.default_rng(0).random((4, 5)) < 0.5
        found = our_gradients(scene, view, weights, tiles=tiles)
        kept = torch.tensor(np.kron(tiles, np.ones((16, 16)))[:50, :70])
        masked = {name: w * (kept[..., None] if w.ndim == 3 else kept) for name, w in weights.items()}
        for one, other in zip(found, our_gradients(scene, view, masked), strict=True):
            np.testing.assert_array_equal(one, other)
        assert found[0].any()

    def test_quaternion_gradient_is_tangent_and_falls_with_the_norm(self) -> None:
        scene, view = random_scene(11, 50), CAMERAS["plain"]
        weights = image_weights(view)
        one = our_gradients(scene, view, weights)[1]
        across = np.abs((one * scene.quats).sum(1)) / np.linalg.norm(scene.quats, axis=1)
        assert across.max() <= 1e-5 * np.abs(one).max()
        four = our_gradients(replace(scene, quats=scene.quats * np.float32(4)), view, weights)[1]
        np.testing.assert_allclose(four, one / 4, atol=1e-6 * np.abs(one).max())

    def test_moving_the_world_and_the_camera_together_changes_nothing(self) -> None:
        scene, far = random_scene(12, 200), np.array([4096.0, -8192.0, 2048.0])
        weights = image_weights(CAMERAS["plain"])
        moved = camera(33, 23, focal=28.0, eye=far + np.array([3, 2, 1]), target=far)
        means = (scene.means.astype(np.float64) + far).astype(np.float32)
        near = replace(scene, means=(means.astype(np.float64) - far).astype(np.float32))
        truth = our_gradients(near, CAMERAS["plain"], weights)
        assert_gradients_match(our_gradients(replace(near, means=means), moved, weights), truth)


class TestEdgeCases:
    @pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 129])
    def test_any_number_of_gaussians(self, count: int) -> None:
        scene, view = random_scene(13, count), camera(20, 20)
        weights = image_weights(view)
        assert_gradients_match(our_gradients(scene, view, weights), true_gradients(scene, view, weights))

    def test_nothing_in_view(self) -> None:
        raster = rasterize_seen(*parameters(gaussians([[0.0, 0.0, -3.0]])), front_camera(), background=BACKGROUND)
        raster.color.sum().backward()
        assert len(raster.seen) == len(raster.seen_gradients().means) == 0
        np.testing.assert_allclose(raster.color.detach()[3, 5], BACKGROUND)

    @pytest.mark.parametrize(
        ("name", "value"),
        [("means", np.nan), ("quats", 0.0), ("log_scales", np.nan), ("log_scales", -np.inf), ("opacity_logits", np.nan),
         ("opacity_logits", -np.inf), ("opacity_logits", np.inf), ("sh", np.nan), ("quats", 1e-25), ("quats", 1e25)],
    )  # fmt: skip
    def test_a_poisoned_gaussian_leaves_the_others_finite(self, name: str, value: float) -> None:
        scene, view = random_scene(14, 40), CAMERAS["plain"]
        raw = parameters(scene)
        with torch.no_grad():
            raw[NAMES.index(name)][5] = value
        weights = image_weights(view)
        loss_of(rasterize(*raw, view, outputs=OUTPUTS), weights).backward()
        others = np.arange(40) != 5
        assert all(np.isfinite(p.grad.numpy()[others]).all() for p in raw)

    def test_gradient_of_a_rasters_images_is_asked_for_once(self) -> None:
        raster = rasterize_seen(*parameters(random_scene(15, 10)), front_camera())
        with pytest.raises(ValueError, match="no gradient has reached"):
            raster.seen_gradients()
        raster.color.sum().backward()
        raster.seen_gradients()
        with pytest.raises(ValueError, match="given back"):
            raster.seen_gradients()
        with pytest.raises(ValueError, match="given back"):
            _ = raster.radius_px

    def test_parameters_changed_before_backward_are_noticed(self) -> None:
        raw = parameters(random_scene(20, 10))
        raster = rasterize(*raw, front_camera())
        with torch.no_grad():
            raw[0] += 1.0
        with pytest.raises(RuntimeError, match="modified by an inplace operation"):
            raster.color.sum().backward()

    def test_two_drawings_at_once_keep_their_own_memory(self) -> None:
        scene, view = random_scene(16, 300), CAMERAS["plain"]
        weights = image_weights(view)
        alone = our_gradients(scene, view, weights)
        raw, other = parameters(scene), parameters(random_scene(17, 500))
        one = rasterize(*raw, view, background=BACKGROUND, outputs=OUTPUTS)
        two = rasterize(*other, CAMERAS["telephoto"], outputs=("color",))
        two.color.sum().backward()
        render(scene, view)
        loss_of(one, weights).backward()
        for p, truth in zip(raw, alone, strict=True):
            np.testing.assert_array_equal(p.grad, truth)

    @pytest.mark.parametrize(
        ("field", "change"),
        [
            ("means", lambda raw: [raw[0].double(), *raw[1:]]),
            ("sh", lambda raw: [*raw[:4], raw[4][:, :2]]),
        ],
    )
    def test_parameters_of_another_shape_or_type_are_refused(self, field: str, change) -> None:
        raw = parameters(random_scene(18, 10))
        with pytest.raises(InputError, match=field):
            rasterize(*change(raw), front_camera())

    @pytest.mark.parametrize(
        "options",
        [{"sh_degree": 2}, {"near": -1.0}, {"outputs": ("colour",)}, {"outputs": ()}, {"outputs": "color"},
         {"tiles": np.ones((2, 2), bool)}, {"threads": 0}],
    )  # fmt: skip
    def test_arguments_are_checked(self, options: dict) -> None:
        with pytest.raises(InputError, match=next(iter(options))):
            rasterize(*parameters(random_scene(19, 10)), front_camera(), **options)
