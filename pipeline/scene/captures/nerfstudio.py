"""nerfstudio `transforms.json`: camera-to-world poses in OpenGL axes, lens for all frames or for each."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from pipeline.geometry import invert_rigid, nearest_rigid, opengl_to_opencv, validate_pose
from pipeline.scene.captures.views_file import Photographs, ViewsFile, camera_of, require_views, view_names
from pipeline.scene.views import View
from schemas.errors import InputError
from schemas.storage import join, local_path, read_bytes

PINHOLE_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "PERSPECTIVE")
"""Models that are a pinhole once their distortion is zero."""

DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")

IMAGE_SUFFIXES = ("", ".png", ".jpg", ".jpeg", ".JPG", ".PNG")
"""Some writers leave the suffix out."""


def read_nerfstudio(uri: str, *, strict: bool = True) -> ViewsFile:
    """Return the views of a transforms.json.

    Args:
        uri: Path or URI of the file; images are looked for beside it.
        strict: Raise on the first unusable pose instead of skipping it.

    Raises:
        InputError: The file cannot be read, the lens is missing or distorted, or (strict: any, else every) pose is
            unusable.
    """
    uri = str(uri)
    document = _document(uri)
    frames: list[dict[str, Any]] = document["frames"]
    photographs = Photographs(uri.rsplit("/", 1)[0] if "/" in uri else ".")
    paths = [_text(uri, frame, "file_path", i) for i, frame in enumerate(frames)]
    given = [frame.get("view_name") for frame in frames]
    names = view_names([name if isinstance(name, str) else path for name, path in zip(given, paths, strict=True)])
    views, skipped = [], []
    for i, (frame, path, name) in enumerate(zip(frames, paths, names, strict=True)):
        subject = f"{uri} frame {i} ({name})"
        lens = {**{key: value for key, value in document.items() if key != "frames"}, **frame}
        K, width, height = _intrinsics(lens, subject)
        try:
            pose = invert_rigid(nearest_rigid(validate_pose(opengl_to_opencv(_matrix(frame, subject)), subject)))
        except InputError as error:
            if strict:
                raise
            skipped.append(str(error))
            continue
        depth = frame.get("depth_file_path")
        image_at = photographs.find(path, IMAGE_SUFFIXES)
        depth_at = photographs.find(depth) if isinstance(depth, str) else None
        views.append(View(name, camera_of(K, pose, width, height, subject), image_at, depth_at))
    return require_views(ViewsFile(tuple(views), tuple(skipped)), uri)


def transforms_json(views: Sequence[View], folder: str) -> bytes:
    """Return a transforms.json of these views.

    Args:
        views: Views in order.
        folder: Where the file will lie; images below it are written relative to it.
    """
    frames = []
    for view in views:
        pose = np.vstack([opengl_to_opencv(view.camera.camera_to_world), [0.0, 0.0, 0.0, 1.0]])
        K = view.camera.K
        frame: dict[str, Any] = {
            "file_path": _relative(view.image, folder) if view.image else f"images/{view.name}.png",
            "view_name": view.name,
            "transform_matrix": pose.tolist(),
            **{"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]},
            **{"w": view.camera.width, "h": view.camera.height},
        }
        if view.depth:
            frame["depth_file_path"] = _relative(view.depth, folder)
        frames.append(frame)
    shared = {key: frames[0][key] for key in LENS if frames and all(f[key] == frames[0][key] for f in frames)}
    frames = [{key: value for key, value in frame.items() if key not in shared} for frame in frames]
    document = {"camera_model": "PINHOLE", **shared, "frames": frames}
    return json.dumps(document, indent=1, allow_nan=False).encode()


LENS = ("fl_x", "fl_y", "cx", "cy", "w", "h")


def _relative(path: str, folder: str) -> str:
    """Return a path or URI relative to the folder where it lies below it, else one that stands alone."""
    inner, outer = local_path(path), local_path(folder)
    if inner is None or outer is None:
        return path.removeprefix(join(folder, "").rstrip("/") + "/")
    inner, outer = inner.resolve(), outer.resolve()
    return inner.relative_to(outer).as_posix() if inner.is_relative_to(outer) else str(inner)


def _document(uri: str) -> dict[str, Any]:
    try:
        # Python's reader takes NaN and Infinity, which broken captures hold: the pose check names them.
        document = json.loads(read_bytes(uri))
    except (ValueError, RecursionError) as error:
        raise InputError(uri, expected="JSON", found=error) from error
    frames = document.get("frames") if isinstance(document, dict) else None
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        found = f"{len(frames)} entries" if isinstance(frames, list) else type(frames).__name__
        raise InputError(uri, field="frames", expected="a list of at least one frame", found=found)
    return document


def _text(uri: str, frame: dict[str, Any], key: str, index: int) -> str:
    value = frame.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{uri} frame {index}", field=key, expected="a path", found=value)
    return value


def _matrix(frame: dict[str, Any], subject: str) -> Float[np.ndarray, "r 4"]:
    value = frame.get("transform_matrix")
    try:
        matrix = np.array(value, np.float64)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise InputError(subject, field="transform_matrix", expected="3x4 or 4x4 numbers", found=str(value)[:80])
    return matrix


def _intrinsics(lens: dict[str, Any], subject: str) -> tuple[Float[np.ndarray, "3 3"], int, int]:
    model = lens.get("camera_model", "PINHOLE")
    if model not in PINHOLE_MODELS:
        raise InputError(subject, field="camera_model", expected=f"one of {', '.join(PINHOLE_MODELS)}", found=model)
    for key in DISTORTION:
        if _number(lens, key, subject, 0.0) != 0:
            expected = "0: undistort the capture first, renders here are pinhole"
            raise InputError(subject, field=key, expected=expected, found=lens[key])
    width, height = (_number(lens, key, subject, None) for key in ("w", "h"))
    angle = _number(lens, "camera_angle_x", subject, 0.0)
    if "fl_x" not in lens and 0 < angle < math.pi:
        fx = 0.5 * width / math.tan(0.5 * angle)
    else:
        fx = _number(lens, "fl_x", subject, None)
    fy = _number(lens, "fl_y", subject, fx)
    cx, cy = _number(lens, "cx", subject, width / 2), _number(lens, "cy", subject, height / 2)
    if width != int(width) or height != int(height):
        raise InputError(subject, field="w, h", expected="whole pixels", found=(width, height))
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), int(width), int(height)


def _number(lens: dict[str, Any], key: str, subject: str, default: float | None) -> float:
    value = lens.get(key, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(subject, field=key, expected="a number", found=value)
    return float(value)
