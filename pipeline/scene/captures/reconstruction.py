"""Captures of reconstruction programs: nerfstudio and COLMAP projects with images, depth and sparse points."""

from __future__ import annotations

import posixpath
import re
import struct
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32

from pipeline.scene.captures.capture import Capture, DepthReader, Frame, PointsReader, Skipped, SparsePoints
from pipeline.scene.captures.colmap import read_colmap
from pipeline.scene.captures.image_files import MILLIMETRE_M, DepthFile, ImageFile, depth_in_metres, image_size
from pipeline.scene.captures.nerfstudio import read_nerfstudio
from pipeline.scene.captures.views_file import Photographs, ViewsFile
from pipeline.scene.scene_file import COLMAP_FOLDERS
from pipeline.scene.views import View
from schemas.errors import InputError
from schemas.storage import exists, join, name_of, read_bytes

DEPTH_FOLDERS = ("depth", "depths")
"""Where a COLMAP project's depth PNGs are looked for; millimetres, named as the images."""
DENSE_DEPTH = "stereo/depth_maps"
"""Where COLMAP's dense stereo puts its own."""
_DENSE_HEAD = re.compile(rb"(\d{1,6})&(\d{1,6})&1&")


@dataclass(frozen=True, slots=True)
class ColmapDepth:
    """A depth map of COLMAP's dense stereo, in the reconstruction's own unit."""

    uri: str
    """Path or URI."""

    def read(self) -> Float32[np.ndarray, "h w"]:
        """Return z-depth, 0 where there is none.

        Raises:
            InputError: It is missing or cut short.
        """
        data = read_bytes(self.uri)
        head = _DENSE_HEAD.match(data)
        width, height = (int(head[1]), int(head[2])) if head else (0, 0)
        if head is None or len(data) != head.end() + 4 * width * height:
            expected = "width&height&1& and that many float32"
            raise InputError(self.uri, expected=expected, found=f"{len(data)} bytes from {data[:20]!r}")
        return depth_in_metres(np.frombuffer(data, "<f4", offset=head.end()).reshape(height, width), 1.0)


@dataclass(frozen=True, slots=True)
class ColmapPoints:
    """points3D of a COLMAP model."""

    uri: str
    """points3D.bin or points3D.txt."""

    def read(self) -> SparsePoints:
        """Return the points, in file order.

        Raises:
            InputError: The file is missing, cut short or no such file.
        """
        data = read_bytes(self.uri)
        return _text_points(data, self.uri) if self.uri.endswith(".txt") else _binary_points(data, self.uri)


def read_nerfstudio_capture(uri: str, *, depth_unit_m: float = MILLIMETRE_M, name: str = "") -> Capture:
    """Return the capture of a transforms.json with its images and depth.

    Args:
        uri: The file, or the folder it lies in.
        depth_unit_m: Metres of one step of the depth files (16-bit PNG or .npy); nerfstudio's default is 0.001.
        name: Scene name; empty takes the folder's.

    Raises:
        InputError: The file is wrong, or no pose is usable.
    """
    at = str(uri) if str(uri).endswith(".json") else join(str(uri), "transforms.json")
    folder = at.rsplit("/", 1)[0] if "/" in at else "."
    found = read_nerfstudio(at, strict=False)
    depths = {v.name: DepthFile(v.depth, depth_unit_m) for v in found.views if v.depth is not None}
    return _capture(name or name_of(folder), found, depths)


def read_colmap_capture(uri: str, *, name: str = "") -> Capture:
    """Return the capture of a COLMAP project: images/, a sparse model, and depth where there is any.

    Depth is looked for as PNGs in millimetres in depth/, then as dense stereo's maps in stereo/depth_maps.

    Args:
        uri: Project folder, or the folder of the model itself.
        name: Scene name; empty takes the folder's.

    Raises:
        InputError: There is no model or it is wrong, or no pose is usable.
    """
    uri = str(uri)
    model = next((at for at in (join(uri, folder) for folder in COLMAP_FOLDERS) if _is_model(at)), uri)
    found = read_colmap(model, images=join(uri, "images"), strict=False)
    # The views' names lose folder and suffix, and depth maps are named by the whole: views and images share an order.
    files, depths = Photographs(uri), dict[str, DepthReader]()
    for view in found.views:
        reader = _colmap_depth(files, view.image.removeprefix(join(uri, "images")).strip("/")) if view.image else None
        if reader is not None:
            depths[view.name] = reader
    points = next((join(model, f"points3D{s}") for s in (".bin", ".txt") if exists(join(model, f"points3D{s}"))), None)
    return _capture(name or name_of(uri), found, depths, None if points is None else ColmapPoints(points))


def _is_model(uri: str) -> bool:
    return any(exists(join(uri, name)) for name in ("images.bin", "images.txt"))


def _colmap_depth(files: Photographs, image: str) -> DepthReader | None:
    stem = posixpath.splitext(image)[0]
    png = next((at for f in DEPTH_FOLDERS if (at := files.find(f"{f}/{stem}.png")) is not None), None)
    if png is not None:
        return DepthFile(png)
    dense = files.find(f"{DENSE_DEPTH}/{image}", (".geometric.bin", ".photometric.bin"))
    return None if dense is None else ColmapDepth(dense)


def _capture(
    name: str,
    found: ViewsFile,
    depths: dict[str, DepthFile] | dict[str, DepthReader],
    points: PointsReader | None = None,
) -> Capture:
    """Return the capture of views; depth that is smaller than the photographs keeps its own lens."""
    size = _depth_size(next(iter(depths.values()))) if depths else None
    frames = tuple(_frame(view, depths.get(view.name), size) for view in found.views)
    skipped = tuple(Skipped("", "broken pose", line) for line in found.skipped)
    missing = len(frames) - sum(frame.depth is not None for frame in frames)
    notes = (f"{missing} of {len(frames)} frames have no depth image",) if depths and missing else ()
    return Capture(name, frames, skipped, notes, points=points)


def _depth_size(reader: DepthReader) -> tuple[int, int]:
    if isinstance(reader, DepthFile):
        return image_size(reader.uri)
    height, width = reader.read().shape
    return width, height


def _frame(view: View, depth: DepthReader | None, size: tuple[int, int] | None) -> Frame:
    frame = Frame(view.name, view.camera, ImageFile(view.image) if view.image is not None else None, depth)
    if depth is None or size is None or size == (view.camera.width, view.camera.height):
        return frame
    return replace(frame, depth_camera=view.camera.resized(*size))


def _text_points(data: bytes, uri: str) -> SparsePoints:
    positions, colors = [], []
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), start=1):
        words = line.split(maxsplit=7)
        if not words or words[0].startswith("#"):
            continue
        try:
            positions.append([float(word) for word in words[1:4]])
            colors.append([int(word) for word in words[4:7]])
            if len(colors[-1]) < 3:
                raise ValueError("too few words")
        except ValueError as error:
            raise InputError(f"{uri} line {number}", expected="ID X Y Z R G B ...", found=repr(line[:80])) from error
    return SparsePoints(np.array(positions, np.float64).reshape(-1, 3), np.array(colors, np.uint8).reshape(-1, 3))


def _binary_points(data: bytes, uri: str) -> SparsePoints:
    head = struct.Struct("<Q3d3BdQ")
    try:
        count = struct.unpack_from("<Q", data)[0]
        # Each point needs its head at least: a damaged count must not ask for the memory of a planet.
        if count > len(data) // head.size:
            raise struct.error(f"{count} points in {len(data)} bytes")
        positions, colors, at = np.empty((count, 3)), np.empty((count, 3), np.uint8), 8
        for row in range(count):
            _, x, y, z, r, g, b, _, track = head.unpack_from(data, at)
            positions[row], colors[row] = (x, y, z), (r, g, b)
            at += head.size + 8 * track
    except struct.error as error:
        raise InputError(uri, expected="a whole points3D.bin", found=error) from error
    return SparsePoints(positions, colors)
