from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.metrics.image_quality import ssim
from schemas.errors import InputError

torch = pytest.importorskip("torch")

from pipeline.construct.training.losses import depth_weight, inverse_depth_loss, photometric_loss, torch_ssim  # noqa: E402

FLOAT32 = 2e-6
"""Relative: sums of 121 products in single precision."""


def _images(height: int, width: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    photo = rng.random((height, width, 3), np.float32)
    color = photo + rng.normal(0, 0.2, photo.shape).astype(np.float32)
    return torch.from_numpy(color).requires_grad_(), torch.from_numpy(photo)


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 70), st.integers(1, 40), st.sampled_from([0.2, 0.7, 1.0]), st.integers(0, 99))
def test_compiled_loss_and_gradient_are_those_of_torch_in_float64(
    height: int, width: int, weight: float, seed: int
) -> None:
    color, photo = _images(height, width, seed)
    exact = color.detach().double().requires_grad_()
    expected = photometric_loss(exact, photo.double(), weight)
    (3.0 * expected).backward()
    loss = photometric_loss(color, photo, weight, threads=2)
    (3.0 * loss).backward()
    assert loss.item() == pytest.approx(expected.item(), rel=FLOAT32)
    assert float((color.grad - exact.grad).abs().max()) <= FLOAT32 * 10 * float(exact.grad.abs().max())


def test_gradient_of_torch_ssim_meets_finite_differences() -> None:
    color, photo = _images(5, 4, 0)
    exact = color.detach().double().requires_grad_()
    assert torch.autograd.gradcheck(lambda x: torch_ssim(x, photo.double()), exact, fast_mode=True)


def test_ssim_is_the_metric_of_that_name() -> None:
    color, photo = _images(33, 21, 1)
    color = color.detach().clamp(0, 1)
    assert float(torch_ssim(color, photo)) == pytest.approx(ssim(color.numpy(), photo.numpy()), abs=1e-6)


def test_equal_images_have_no_loss_and_no_gradient() -> None:
    _, photo = _images(20, 20, 2)
    color = photo.clone().requires_grad_()
    loss = photometric_loss(color, photo)
    loss.backward()
    assert abs(loss.item()) < 1e-6
    assert float(color.grad.abs().max()) < 1e-7


def test_threads_change_no_bit() -> None:
    results = []
    for threads in (1, 3):
        color, photo = _images(200, 64, 3)
        loss = photometric_loss(color, photo, threads=threads)
        loss.backward()
        results.append((loss.detach(), color.grad))
    assert torch.equal(results[0][0], results[1][0])
    assert torch.equal(results[0][1], results[1][1])


def test_without_dssim_the_loss_is_l1() -> None:
    color, photo = _images(8, 8, 4)
    assert photometric_loss(color, photo, 0.0).item() == pytest.approx((color - photo).abs().mean().item(), rel=1e-6)


def test_images_of_two_sizes_are_refused() -> None:
    with pytest.raises(InputError, match="color"):
        photometric_loss(torch.zeros(4, 4, 3), torch.zeros(4, 5, 3))


def test_inverse_depth_counts_measured_pixels_over_all_pixels() -> None:
    rendered = torch.tensor([[0.5, 0.7], [9.0, 0.25]], requires_grad=True)
    loss = inverse_depth_loss(rendered, torch.tensor([[0.25, 0.75], [0.0, 0.25]]))
    loss.backward()
    assert loss.item() == pytest.approx((0.25 + 0.05) / 4)
    assert rendered.grad.tolist() == [[0.25, -0.25], [0.0, 0.0]]


def test_depth_weight_falls_log_linearly_and_stays_within_its_ends() -> None:
    assert [depth_weight(share) for share in (0.0, 0.5, 1.0, 2.0)] == pytest.approx([1.0, 0.1, 0.01, 0.01])
