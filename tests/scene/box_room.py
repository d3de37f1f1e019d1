"""A box room seen by a few cameras, written in every capture format: depth is known at each pixel."""

from __future__ import annotations

import json
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.geometry import Camera, look_at, opengl_to_opencv, rotations_to_quats

HIGH = np.array([4.0, 3.0, 2.5])
"""Far corner, metres; the near one is the origin."""
WIDTH, HEIGHT = 64, 36
FOCAL = 32.0
"""A horizontal field of view of 90 degrees, as Habitat renders it."""
DEPTH_SIZE = (32, 18)


def cameras(up: tuple[float, float, float] = (0.0, 0.0, 1.0), width: int = WIDTH, height: int = HEIGHT) -> list[Camera]:
    K = np.array([[FOCAL * width / WIDTH, 0, width / 2], [0, FOCAL * width / WIDTH, height / 2], [0, 0, 1.0]])
    eyes = [(1.0, 1.0, 1.2), (1.3, 1.1, 1.2), (2.0, 1.5, 1.4), (2.5, 1.2, 1.0)]
    targets = [(3.0, 2.0, 1.0), (3.0, 2.2, 0.9), (3.5, 2.9, 0.8), (0.4, 2.0, 1.5)]
    return [
        Camera(K, look_at(np.array(e), np.array(t), np.array(up)), width, height)
        for e, t in zip(eyes, targets, strict=True)
    ]


def depth_m(camera: Camera) -> np.ndarray:
    """Return exact z-depth: the nearest wall along each pixel's ray."""
    rays = camera.unproject(np.ones((camera.height, camera.width))) @ camera.world_to_camera[:, :3]
    with np.errstate(divide="ignore"):
        far = np.where(rays > 0, (HIGH - camera.center) / rays, -camera.center / rays)
    return far.min(axis=-1)


def picture(camera: Camera) -> np.ndarray:
    """Return colours that depend on the place on the wall."""
    world = world_points(camera, depth_m(camera))
    return np.clip(world / HIGH * 255, 0, 255).astype(np.uint8)


def world_points(camera: Camera, depth: np.ndarray) -> np.ndarray:
    pose = camera.camera_to_world
    return camera.unproject(depth) @ pose[:, :3].T + pose[:, 3]


def off_walls_m(points: np.ndarray) -> np.ndarray:
    """Return how far points are from the nearest wall."""
    return np.minimum(np.abs(points), np.abs(HIGH - points)).min(axis=-1)


def _camera_to_world(camera: Camera) -> np.ndarray:
    return np.vstack([camera.camera_to_world, [0, 0, 0, 1]])


def _matrix(path: Path, matrix: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, matrix, fmt="%.6f")


def _wide(K: np.ndarray) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = K
    return out


def save_image(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, quality=95)


def write_scannet(folder: Path) -> Path:
    """OpenEQA's flat layout, with depth smaller than colour."""
    for i, (camera, small) in enumerate(zip(cameras(), cameras(width=32, height=18), strict=True)):
        save_image(folder / f"{i:06d}-rgb.png", picture(camera))
        save_image(folder / f"{i:06d}-depth.png", np.rint(depth_m(small) * 1000).astype(np.uint16))
        _matrix(folder / f"{i:06d}.txt", _camera_to_world(camera))
    _matrix(folder / "intrinsic_color.txt", _wide(camera.K))
    _matrix(folder / "intrinsic_depth.txt", _wide(small.K))
    return folder


def write_nested(folder: Path) -> Path:
    """ScanNet's own export: a folder a kind, numbers without zeros."""
    for i, camera in enumerate(cameras()):
        save_image(folder / f"color/{i * 9}.jpg", picture(camera))
        save_image(folder / f"depth/{i * 9}.png", np.rint(depth_m(camera) * 1000).astype(np.uint16))
        _matrix(folder / f"pose/{i * 9}.txt", _camera_to_world(camera))
    _matrix(folder / "intrinsic/intrinsic_color.txt", _wide(camera.K))
    return folder


def write_hm3d(folder: Path, *, buggy: bool = True) -> Path:
    """OpenEQA's HM3D half: y up, OpenGL axes, depth in 1/65535 of 10 m, and the extractor's wrong fy."""
    for i, camera in enumerate(cameras(up=(0.0, 1.0, 0.0))):
        save_image(folder / f"{i:05d}-rgb.png", picture(camera))
        save_image(folder / f"{i:05d}-depth.png", (depth_m(camera) / 10 * 65535).astype(np.uint16))
        pose = _camera_to_world(camera)
        pose[:3] = opengl_to_opencv(pose)
        _matrix(folder / f"{i:05d}.txt", pose)
    K = camera.K.copy()
    if buggy:
        K[1, 1] = HEIGHT / 2 / np.tan(np.pi / 2 * HEIGHT / WIDTH / 2)
    for kind in ("color", "depth"):
        _matrix(folder / f"intrinsic_{kind}.txt", _wide(K))
    return folder


def write_seven_scenes(folder: Path) -> Path:
    for i, camera in enumerate(cameras()):
        steps = np.rint(depth_m(camera) * 1000).astype(np.uint16)
        steps[0, :3] = 65535
        steps[1, :3] = 0
        save_image(folder / f"frame-{i:06d}.color.png", picture(camera))
        save_image(folder / f"frame-{i:06d}.depth.png", steps)
        _matrix(folder / f"frame-{i:06d}.pose.txt", _camera_to_world(camera))
    _matrix(folder / "camera-intrinsics.txt", camera.K)
    return folder


def sens_bytes(poses: list[np.ndarray] | None = None, **head: Any) -> bytes:
    """Return a .sens file; `head` replaces fields."""
    large, small = cameras(), cameras(width=32, height=18)
    matrices = [_camera_to_world(camera) for camera in large] if poses is None else poses
    name = b"StructureSensor"
    out = [struct.pack("<IQ", head.get("version", 4), len(name)), name]
    out += [m.astype("<f4").tobytes() for m in (_wide(large[0].K), np.eye(4), _wide(small[0].K), np.eye(4))]
    out += [struct.pack("<2i4If", head.get("color", 2), head.get("depth", 1), WIDTH, HEIGHT, *DEPTH_SIZE, 1000.0)]
    out += [struct.pack("<Q", head.get("frames", len(matrices)))]
    for matrix, camera, view in zip(matrices, large, small, strict=False):
        buffer = BytesIO()
        Image.fromarray(picture(camera)).save(buffer, "JPEG", quality=95)
        depth = np.rint(depth_m(view) * 1000).astype("<u2").tobytes()
        depth = zlib.compress(depth) if head.get("depth", 1) == 1 else depth
        out += [matrix.astype("<f4").tobytes(), struct.pack("<4Q", 7, 8, buffer.tell(), len(depth))]
        out += [buffer.getvalue(), depth]
    return b"".join(out) + b"motion records follow"


def write_sens(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene0001_00.sens").write_bytes(sens_bytes())
    return folder


def write_nerfstudio(folder: Path) -> Path:
    frames = []
    for i, (camera, small) in enumerate(zip(cameras(), cameras(width=32, height=18), strict=True)):
        save_image(folder / f"images/{i}.png", picture(camera))
        save_image(folder / f"depth/{i}.png", np.rint(depth_m(small) * 1000).astype(np.uint16))
        pose = _camera_to_world(camera)
        pose[:3] = opengl_to_opencv(pose)
        files = {"file_path": f"images/{i}.png", "depth_file_path": f"depth/{i}.png"}
        frames.append({**files, "transform_matrix": pose.tolist()})
    lens = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2, "w": WIDTH, "h": HEIGHT}
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
    return folder


def write_colmap(folder: Path, *, dense: bool = False) -> Path:
    model = folder / "sparse/0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text(f"1 SIMPLE_PINHOLE {WIDTH} {HEIGHT} {FOCAL} {WIDTH / 2} {HEIGHT / 2}\n")
    lines = []
    for i, camera in enumerate(cameras()):
        save_image(folder / f"images/{i}.png", picture(camera))
        depth = depth_m(camera)
        if dense:
            at = folder / f"stereo/depth_maps/{i}.png.geometric.bin"
            at.parent.mkdir(parents=True, exist_ok=True)
            at.write_bytes(f"{WIDTH}&{HEIGHT}&1&".encode() + depth.astype("<f4").tobytes())
        else:
            save_image(folder / f"depth/{i}.png", np.rint(depth * 1000).astype(np.uint16))
        quat = rotations_to_quats(camera.world_to_camera[:, :3])
        numbers = " ".join(repr(float(x)) for x in (*quat, *camera.world_to_camera[:, 3]))
        lines += [f"{i + 1} {numbers} 1 {i}.png", ""]
    (model / "images.txt").write_text("\n".join(lines))
    (model / "points3D.txt").write_text("# comment\n1 0.5 0 1.25 10 20 30 0.1 1 0\n2 4 1 1 255 0 0 0.2\n")
    return folder


WRITERS = {
    "scannet": write_scannet,
    "nested-scannet": write_nested,
    "hm3d": write_hm3d,
    "7scenes": write_seven_scenes,
    "sens": write_sens,
    "nerfstudio": write_nerfstudio,
    "colmap": write_colmap,
    "dense-colmap": lambda folder: write_colmap(folder, dense=True),
}
"""By a folder name that tells the convention where the format needs it."""
