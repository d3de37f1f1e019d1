"""Alpha of one Gaussian with 60 digits, by the plain formula: where float64 itself could be in doubt."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np

from pipeline.geometry import Camera
from pipeline.scene.gaussians import Gaussians

DIGITS = 60


def exact_alpha(scene: Gaussians, camera: Camera) -> np.ndarray:
    """Return (H, W) alpha of the scene's only Gaussian seen by a camera at the origin that looks along +z.

    The covariance is multiplied out and inverted by its determinant, the step that cancels in binary arithmetic.
    """
    assert len(scene) == 1
    assert np.array_equal(camera.world_to_camera, np.eye(3, 4))
    with localcontext() as context:
        context.prec = DIGITS
        w, x, y, z = (Decimal(float(value)) for value in scene.quats[0])
        norm = (w * w + x * x + y * y + z * z).sqrt()
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        turn = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        sizes = [Decimal(float(value)).exp() for value in scene.log_scales[0]]
        covariance = [
            [sum(turn[i][k] * turn[j][k] * sizes[k] ** 2 for k in range(3)) for j in range(3)] for i in range(3)
        ]
        mean = [Decimal(float(value)) for value in scene.means[0]]
        (fx, _, cx), (_, fy, cy), _ = [[Decimal(float(value)) for value in row] for row in camera.K]
        # The clamp does not act: these cases lie near the optical axis.
        jacobian = [
            [fx / mean[2], Decimal(0), -fx * mean[0] / mean[2] ** 2],
            [Decimal(0), fy / mean[2], -fy * mean[1] / mean[2] ** 2],
        ]
        image = [
            [sum(a[i] * covariance[i][j] * b[j] for i in range(3) for j in range(3)) for b in jacobian]
            for a in jacobian
        ]
        xx, xy, yy = image[0][0] + Decimal("0.3"), image[0][1], image[1][1] + Decimal("0.3")
        determinant = xx * yy - xy * xy
        u, v = fx * mean[0] / mean[2] + cx, fy * mean[1] / mean[2] + cy
        opacity = 1 / (1 + (-Decimal(float(scene.opacity_logits[0]))).exp())
        alpha = np.zeros((camera.height, camera.width))
        for row in range(camera.height):
            for column in range(camera.width):
                dx, dy = Decimal(column) + Decimal("0.5") - u, Decimal(row) + Decimal("0.5") - v
                power = -(yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (2 * determinant)
                if power < -10:
                    continue
                value = min(Decimal(float(np.float32(0.99))), opacity * power.exp())
                alpha[row, column] = float(value) if value >= 1 / Decimal(255) else 0.0
    return alpha
