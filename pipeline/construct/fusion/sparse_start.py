"""Gaussians from the sparse points of a reconstruction: the start of a scene without depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pipeline.construct.mesh.mesh_surfels import SH_C0
from pipeline.geometry import Camera
from pipeline.scene import Gaussians
from pipeline.scene.captures import SparsePoints
from schemas.errors import InputError

NEIGHBOURS = 3
"""Nearest points whose root mean square distance is a Gaussian's scale (3DGS)."""
OPACITY_LOGIT = float(np.log(0.1 / 0.9))
"""Opacity 0.1, as 3DGS starts: training raises it where it helps."""
WIDEST_SHARE = 0.1
"""Cap on a scale as a share of the distance to the nearest camera: a lone point must not veil a whole image."""
ALONE = 20.0
"""A point is an outlier where its neighbours are this many times farther away, against its distance from the nearest
camera, than those of the median point: points along badly conditioned rays are."""


def start_from_points(points: SparsePoints, cameras: Sequence[Camera]) -> Gaussians:
    """Return a round Gaussian of opacity 0.1 for every usable point, as wide as its 3 nearest neighbours are away.

    Left out are points that are not finite, that no camera sees inside its image, and that are alone by far (see
    `ALONE`); points at the same place become one, of the first one's colour.

    Args:
        points: What structure from motion found.
        cameras: The capture's cameras.

    Raises:
        InputError: There is no camera, or fewer than 4 points are usable.
    """
    from scipy.spatial import cKDTree

    if not cameras:
        raise InputError("sparse points", field="cameras", expected="at least one", found="none")
    positions = np.asarray(points.positions, np.float64)
    finite = np.flatnonzero(np.isfinite(positions).all(axis=1))
    _, first = np.unique(positions[finite].astype(np.float32), axis=0, return_index=True)
    kept = finite[np.sort(first)]
    distance = _nearest_camera(positions[kept], cameras)
    kept, distance = kept[np.isfinite(distance)], distance[np.isfinite(distance)]
    _require_enough(len(kept), len(positions))
    spacing = _spacing(cKDTree(positions[kept]), positions[kept])
    near = spacing / distance <= ALONE * np.median(spacing / distance)
    kept, distance = kept[near], distance[near]
    _require_enough(len(kept), len(positions))
    # Outliers were somebody's neighbours: distances are taken anew without them.
    spacing = np.minimum(_spacing(cKDTree(positions[kept]), positions[kept]), WIDEST_SHARE * distance)
    count = len(kept)
    quats = np.zeros((count, 4), np.float32)
    quats[:, 0] = 1.0
    return Gaussians(
        means=positions[kept].astype(np.float32),
        quats=quats,
        log_scales=np.repeat(np.log(spacing).astype(np.float32)[:, None], 3, axis=1),
        opacity_logits=np.full(count, OPACITY_LOGIT, np.float32),
        sh=((points.colors[kept] / 255.0 - 0.5) / SH_C0).astype(np.float32)[:, None, :],
    )


def _spacing(tree: object, positions: Float[np.ndarray, "P 3"]) -> Float[np.ndarray, "P"]:
    """Return the root mean square distance to the nearest points other than itself."""
    distances, _ = tree.query(positions, k=NEIGHBOURS + 1)  # type: ignore[attr-defined]
    return np.sqrt((distances[:, 1:] ** 2).mean(axis=1))


def _nearest_camera(positions: Float[np.ndarray, "P 3"], cameras: Sequence[Camera]) -> Float[np.ndarray, "P"]:
    """Return the distance to the nearest camera that has a point in its image; infinite where none has."""
    nearest = np.full(len(positions), np.inf)
    for camera in cameras:
        pixels, depth = camera.project(positions)
        with np.errstate(invalid="ignore"):
            seen = (depth > 0) & ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
        nearest[seen] = np.minimum(nearest[seen], np.linalg.norm(positions[seen] - camera.center, axis=1))
    return nearest


def _require_enough(usable: int, total: int) -> None:
    if usable <= NEIGHBOURS:
        raise InputError(
            "sparse points", expected=f"at least {NEIGHBOURS + 1} usable ones", found=f"{usable} of {total}"
        )
