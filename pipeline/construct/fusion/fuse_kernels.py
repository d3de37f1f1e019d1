# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Loops of depth fusion: planes through depth pixels, sums in voxels, agreement with a depth image, colours.

Threads share out image rows or points, and each writes only its own. `add_image`, `add_points` and `draw_depth` write
anywhere and run in one thread, in a fixed order: the bits do not depend on the number of threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pipeline.cached_kernels import kernel

KEY_BITS = 20
"""Bits of a voxel's index along an axis: a million voxels, half of them on each side of the origin."""
SECOND_SIDE = 1 << 62
"""Set in the key of what lies in the same voxel but faces the other way: a thin plate has two sides."""
EMPTY = -1
"""Key of a free slot."""
TAPS = 2
"""A plane is fitted to 5 x 5 pixels, which may lie some pixels apart."""
STEEPEST = 2.0
"""Slope of a surface, in metres of depth a metre across, beyond which neighbouring pixels are not taken for one."""
LEAST_TAPS = 13
"""Pixels on the same surface that a plane needs: half of them, so that straight edges keep their pixels."""
LEAST_COSINE = 0.15
"""Of the angle between ray and normal: flatter than 81 degrees, a pixel's depth says little."""
NEAR_M = 0.1
"""Points nearer to a camera are not looked at."""
WIDEST_PX = 8.0
"""Cap on half the side of a drawn point: one that a camera nearly touches must not hide everything."""


@kernel
def fit_planes(
    depth,  # (h, w) float32, metres, 0 none
    lens,  # (4,) float64: fx, fy, cx, cy
    first,  # first row
    last,  # row after the last
    stride,  # pixels between the taps of a plane
    same_surface,  # share of depth that noise moves a pixel by at most
    farthest,  # metres
    fitted,  # (h, w) float32, out: depth of the plane; 0 where there is none
    normals,  # (h, w, 3) float32, out: camera axes, unit, towards the camera
):
    """Fit inverse depth, which is linear in the image on any plane, around each pixel."""
    fx, fy, cx, cy = lens
    height, width = depth.shape
    for row in range(first, last):
        for column in range(width):
            fitted[row, column] = 0.0
            normals[row, column, :] = 0.0
            z = depth[row, column]
            if not (0.0 < z <= farthest):
                continue
            near, limit = 1.0 / z, same_surface * z
            n = su = sv = suu = suv = svv = sq = suq = svq = 0.0
            for i in range(-TAPS, TAPS + 1):
                v = row + i * stride
                if v < 0 or v >= height:
                    continue
                for j in range(-TAPS, TAPS + 1):
                    u = column + j * stride
                    if u < 0 or u >= width:
                        continue
                    other = depth[v, u]
                    x, y = float(j * stride), float(i * stride)
                    if not (0.0 < other < math.inf) or abs(other - z) > limit + STEEPEST * z * (abs(x) + abs(y)) / fx:
                        continue
                    q = 1.0 / other - near
                    n += 1.0
                    su, sv = su + x, sv + y
                    suu, suv, svv = suu + x * x, suv + x * y, svv + y * y
                    sq, suq, svq = sq + q, suq + x * q, svq + y * q
            if n < LEAST_TAPS:
                continue
            su, sv, sq = su / n, sv / n, sq / n
            suu, suv, svv = suu / n - su * su, suv / n - su * sv, svv / n - sv * sv
            suq, svq = suq / n - su * sq, svq / n - sv * sq
            determinant = suu * svv - suv * suv
            if determinant <= 1e-3 * suu * svv:
                continue
            a, b = (svv * suq - suv * svq) / determinant, (suu * svq - suv * suq) / determinant
            q = near + sq - a * su - b * sv
            if q <= 0.0 or abs(1.0 / q - z) > limit:
                continue
            # On the plane normal . X = d, 1/z = (normal . ray) / d with rays (x, y, 1): its slopes are the normal.
            nx, ny = a * fx, b * fy
            nz = q - nx * (column + 0.5 - cx) / fx - ny * (row + 0.5 - cy) / fy
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            fitted[row, column] = 1.0 / q
            normals[row, column, 0] = -nx / length
            normals[row, column, 1] = -ny / length
            normals[row, column, 2] = -nz / length


@njit
def _slot(keys, key):
    """Return where the key is, or the free slot where it belongs."""
    mask = len(keys) - 1
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    at = np.int64(mixed >> np.uint64(24)) & mask
    while keys[at] != key and keys[at] != EMPTY:
        at = (at + 1) & mask
    return at


@njit
def _add(x, y, z, nx, ny, nz, weight, footprint, edge, keys, rows, sums, corners, used):
    """Add one point to its voxel and return the rows used."""
    i, j, k = math.floor(x / edge), math.floor(y / edge), math.floor(z / edge)
    half, most = 1 << (KEY_BITS - 1), (1 << KEY_BITS) - 1
    key = (((i + half) & most) << (2 * KEY_BITS)) | (((j + half) & most) << KEY_BITS) | ((k + half) & most)
    at = _slot(keys, key)
    if keys[at] == key:
        row = rows[at]
        if sums[row, 4] * nx + sums[row, 5] * ny + sums[row, 6] * nz < -0.2 * sums[row, 0]:
            key |= SECOND_SIDE
            at = _slot(keys, key)
    if keys[at] == EMPTY:
        keys[at], rows[at] = key, used
        corners[used, 0], corners[used, 1], corners[used, 2] = i, j, k
        sums[used, :] = 0.0
        sums[used, 7] = footprint
        used += 1
    row = rows[at]
    sums[row, 0] += weight
    sums[row, 1] += weight * (x - i * edge)
    sums[row, 2] += weight * (y - j * edge)
    sums[row, 3] += weight * (z - k * edge)
    sums[row, 4] += weight * nx
    sums[row, 5] += weight * ny
    sums[row, 6] += weight * nz
    sums[row, 7] = min(sums[row, 7], footprint)
    return used


@kernel
def add_image(
    fitted,  # (h, w) float32
    normals,  # (h, w, 3) float32
    lens,  # (4,) float64
    pose,  # (3, 4) float64, camera to world
    start,  # pixel to begin with
    edge,  # metres
    keys,  # (capacity,) int64, in and out; capacity is a power of 2
    rows,  # (capacity,) int32, in and out: row of `sums`
    sums,  # (capacity / 2, 8) float32, in and out: weight, offset from the voxel's corner, normal, least footprint
    corners,  # (capacity / 2, 3) int32, in and out
    used,  # rows in use
):
    """Add an image's pixels to their voxels; return (rows used, pixels done), fewer than all where there is no room."""
    fx, fy, cx, cy = lens
    width = fitted.shape[1]
    for pixel in range(start, fitted.size):
        row, column = pixel // width, pixel % width
        z = float(fitted[row, column])
        if z <= 0.0:
            continue
        if used >= len(sums):
            return used, pixel
        x, y = (column + 0.5 - cx) / fx, (row + 0.5 - cy) / fy
        a, b, c = normals[row, column]
        cosine = -(a * x + b * y + c) / math.sqrt(1.0 + x * x + y * y)
        if cosine < LEAST_COSINE:
            continue
        x, y = x * z, y * z
        used = _add(
            pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3],
            pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3],
            pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3],
            pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * c,
            pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * c,
            pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * c,
            cosine / (z * z * z * z),  # the depth camera's variance grows so
            z / fx,
            edge,
            keys,
            rows,
            sums,
            corners,
            used,
        )
    return used, fitted.size


@kernel
def add_points(points, normals, weights, footprints, start, edge, keys, rows, sums, corners, used):
    """Add points (n, 3) to their voxels; the rest is as `add_image` has it."""
    for i in range(start, len(points)):
        if used >= len(sums):
            return used, i
        used = _add(
            float(points[i, 0]),
            float(points[i, 1]),
            float(points[i, 2]),
            normals[i, 0],
            normals[i, 1],
            normals[i, 2],
            weights[i],
            footprints[i],
            edge,
            keys,
            rows,
            sums,
            corners,
            used,
        )
    return used, len(points)


@kernel
def rehash(keys, rows, new_keys, new_rows):
    """Put every key of a table into a larger, empty one."""
    for at in range(len(keys)):
        if keys[at] != EMPTY:
            to = _slot(new_keys, keys[at])
            new_keys[to], new_rows[to] = keys[at], rows[at]


@njit
def _local(point, pose):
    """Return a world point in camera axes."""
    x, y, z = float(point[0]), float(point[1]), float(point[2])
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3],
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3],
        pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3],
    )


@njit
def _towards(normal, pose, x, y):
    """Return minus the component of a world normal along the ray (x, y, 1)."""
    a, b, c = normal
    return -(
        (pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * c) * x
        + (pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * c) * y
        + (pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * c)
    )


@njit
def _all_behind(depth, row, column, least):
    """Return whether the 3 x 3 pixels around one are all farther: a lone far pixel beside an edge proves nothing."""
    height, width = depth.shape
    for v in range(max(0, row - 1), min(height, row + 2)):
        for u in range(max(0, column - 1), min(width, column + 2)):
            if not (depth[v, u] > least):
                return False
    return True


@njit
def _between(depth, row, column, u, v, limit):
    """Return depth at a place between four pixels, or that of the pixel it is in where they are of several surfaces.

    Inverse depth is linear on a plane, so a plane's depth comes out exact however large the pixels are.
    """
    height, width = depth.shape
    left, top = math.floor(u - 0.5), math.floor(v - 0.5)
    nearest = depth[row, column]
    if left < 0 or top < 0 or left + 1 >= width or top + 1 >= height:
        return nearest
    a, b, c, d = depth[top, left], depth[top, left + 1], depth[top + 1, left], depth[top + 1, left + 1]
    if not (min(min(a, b), min(c, d)) > nearest - limit and max(max(a, b), max(c, d)) < nearest + limit):
        return nearest
    u, v = u - 0.5 - left, v - 0.5 - top
    return 1.0 / ((1.0 - v) * ((1.0 - u) / a + u / b) + v * ((1.0 - u) / c + u / d))


@kernel
def compare_depth(
    points,  # (n, 3) float32, metres, world
    normals,  # (n, 3) float32, world
    first,  # first point
    last,  # point after the last
    depth,  # (h, w) float32, metres, 0 none
    lens,  # (4,) float64
    pose,  # (3, 4) float64, world to camera
    band,  # share of depth within which a point is on the measured surface
    offsets,  # (n,) float32, in and out: sum of weight times the signed way to the measured surface along the normal
    weights,  # (n,) float32, in and out
    agreed,  # (n,) int16, in and out: images with the point on their surface
    through,  # (n,) int16, in and out: images that look through it
):
    """Hold points against one depth image."""
    fx, fy, cx, cy = lens
    height, width = depth.shape
    for i in range(first, last):
        x, y, z = _local(points[i], pose)
        if z < NEAR_M:
            continue
        x, y = x / z, y / z
        u, v = fx * x + cx, fy * y + cy
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        row, column = int(v), int(u)
        measured, limit = depth[row, column], band * z
        if not (0.0 < measured < math.inf):
            continue
        if measured > z + 2.0 * limit:
            if _all_behind(depth, row, column, z + 2.0 * limit):
                through[i] += 1
            continue
        measured = _between(depth, row, column, u, v, limit)
        if measured < z - limit or measured > z + limit:
            continue
        towards = _towards(normals[i], pose, x, y)
        cosine = towards / math.sqrt(1.0 + x * x + y * y)
        if cosine < LEAST_COSINE:
            continue
        weight = cosine / (z * z * z * z)
        offsets[i] -= weight * (measured - z) * towards
        weights[i] += weight
        agreed[i] += 1


@kernel
def draw_depth(
    points,  # (n, 3) float32, metres, world
    radii,  # (n,) float32, metres
    lens,  # (4,) float64
    pose,  # (3, 4) float64, world to camera
    nearest,  # (H, W) float32, in and out: infinite where nothing is
):
    """Draw every point as a square that faces the camera; the nearest wins."""
    fx, fy, cx, cy = lens
    height, width = nearest.shape
    for i in range(len(points)):
        x, y, z = _local(points[i], pose)
        if z < NEAR_M:
            continue
        u, v = fx * x / z + cx, fy * y / z + cy
        half = min(radii[i] * fx / z, WIDEST_PX)
        if not (-half <= u < width + half and -half <= v < height + half):
            continue
        for row in range(max(0, math.floor(v - half)), min(height, math.floor(v + half) + 1)):
            for column in range(max(0, math.floor(u - half)), min(width, math.floor(u + half) + 1)):
                nearest[row, column] = min(nearest[row, column], z)


@kernel
def add_colors(
    points,  # (n, 3) float32, metres, world
    normals,  # (n, 3) float32, world
    first,  # first point
    last,  # point after the last
    image,  # (H, W, 3) uint8
    nearest,  # (H, W) float32, metres: the nearest surface
    lens,  # (4,) float64
    pose,  # (3, 4) float64, world to camera
    band,  # share of depth by which a point may lie behind the nearest surface and still be seen
    sums,  # (n, 4) float32, in and out: weight, then weight times red, green, blue (0 to 1)
):
    """Add a photograph's colours to the points it shows."""
    fx, fy, cx, cy = lens
    height, width = nearest.shape
    for i in range(first, last):
        x, y, z = _local(points[i], pose)
        if z < NEAR_M:
            continue
        x, y = x / z, y / z
        u, v = fx * x + cx - 0.5, fy * y + cy - 0.5
        if not (0.0 <= u < width - 1 and 0.0 <= v < height - 1):
            continue
        row, column, least = int(v), int(u), z * (1.0 - band)
        u, v = u - column, v - row
        if (
            min(nearest[row, column], nearest[row, column + 1]) < least
            or min(nearest[row + 1, column], nearest[row + 1, column + 1]) < least
        ):
            continue
        cosine = _towards(normals[i], pose, x, y) / math.sqrt(1.0 + x * x + y * y)
        if cosine < LEAST_COSINE:
            continue
        weight = cosine / (z * z)
        sums[i, 0] += weight
        for c in range(3):
            top = (1.0 - u) * image[row, column, c] + u * image[row, column + 1, c]
            bottom = (1.0 - u) * image[row + 1, column, c] + u * image[row + 1, column + 1, c]
            sums[i, 1 + c] += weight * ((1.0 - v) * top + v * bottom) / 255.0
