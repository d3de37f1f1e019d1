"""Frame folders with intrinsics in text files: OpenEQA's, ScanNet's own export, and those rendered by Habitat.

Two layouts: OpenEQA's flat one (`000000-rgb.png`, `000000-depth.png`, `000000.txt`, `intrinsic_color.txt`) and
ScanNet's with a folder for each kind (`color/0.jpg`, `depth/0.png`, `pose/0.txt`, `intrinsic/intrinsic_color.txt`).

Two conventions: ScanNet has OpenCV axes, depth in millimetres and z up; Habitat (HM3D) has OpenGL axes, depth as
png / 65535 * 10 m and y up. Poses are camera-to-world in both.
"""

from __future__ import annotations

import posixpath
from dataclasses import replace
from typing import Literal

import numpy as np

from pipeline.scene.captures.capture import Capture
from pipeline.scene.captures.image_files import MILLIMETRE_M
from pipeline.scene.captures.posed_files import DepthRule, FrameFiles, Lens, posed_frames, read_lens, read_matrix
from schemas.errors import InputError
from schemas.storage import exists, join, list_files, local_path, name_of

Convention = Literal["scannet", "habitat"]
"""Whose axes, depth unit and up direction a frame folder has."""

DEPTH = {"scannet": DepthRule(MILLIMETRE_M), "habitat": DepthRule(10.0 / 65535)}
UP = {"scannet": (0.0, 0.0, 1.0), "habitat": (0.0, 1.0, 0.0)}

IMAGE_ENDINGS = (".png", ".jpg", ".jpeg")
COLOR_FOLDERS = ("color", "rgb")
_BUGGY_FOCAL_TOLERANCE = 0.002
"""Relative; the files hold six decimals, and the wrong focal length is off by a fifth."""


def read_frame_folder(uri: str, convention: Convention | None = None, *, name: str = "") -> Capture:
    """Return the capture in a frame folder.

    HM3D intrinsics written by OpenEQA's extractor have a wrong fy (the vertical field of view taken proportional to
    the height); they are recognised and mended, with a note.

    Args:
        uri: Folder of one scene.
        convention: None takes it from the folder's path, where "hm3d" or "scannet" tells.
        name: Scene name; empty takes the folder's.

    Raises:
        InputError: The folder has no frames, intrinsics or poses, its convention is not known, or no pose is usable.
    """
    uri = str(uri)
    convention = convention or _convention(uri)
    names = list_files(uri)
    nested = not any(n.endswith("-depth.png") or _stem(n, "-rgb") for n in names) and exists(join(uri, "pose"))
    files, intrinsics = _nested(uri) if nested else _flat(uri, names)
    image = next((f.image for f in files if f.image is not None), None)
    depth = next((f.depth for f in files if f.depth is not None), None)
    if not files:
        expected = "*-rgb.png with *.txt beside them, or color/, depth/ and pose/"
        raise InputError(uri, expected=f"a frame folder ({expected})", found="no frames")
    if all(f.pose is None for f in files):
        expected = "a pose file for each frame: extract frames with depth and poses, not RGB only"
        raise InputError(uri, field="pose", expected=expected, found=f"{len(files)} frames, no poses")
    lens = read_lens(join(intrinsics, "intrinsic_color.txt"), image)
    depth_at = join(intrinsics, "intrinsic_depth.txt")
    depth_lens = read_lens(depth_at, depth) if depth is not None and exists(depth_at) else None
    notes: list[str] = []
    if convention == "habitat":
        lens, notes = _square_pixels(lens, join(intrinsics, "intrinsic_color.txt"))
        depth_lens = None if depth_lens is None else _square_pixels(depth_lens, depth_at)[0]
    for extrinsic in ("extrinsic_color.txt", "extrinsic_depth.txt"):
        at = join(intrinsics, extrinsic)
        if exists(at) and not np.allclose(read_matrix(at), np.eye(4), atol=1e-4):
            notes.append(f"{at} is not the identity; poses are taken as they are, as ScanNet's own tools do")
    frames, skipped = posed_frames(files, lens, depth_lens, DEPTH[convention], opengl=convention == "habitat")
    if depth is not None:
        missing = sum(frame.depth is None for frame in frames)
        notes += [f"{missing} of {len(frames)} frames have no depth image"] if missing else []
    return Capture(name or name_of(uri), frames, skipped, tuple(notes), np.array(UP[convention]))


def _convention(uri: str) -> Convention:
    path = local_path(uri)
    words = (str(path.resolve()) if path is not None else uri).rstrip("/").split("/")[-2:]
    for word, convention in (
        ("hm3d", "habitat"),
        ("habitat", "habitat"),
        ("scannet", "scannet"),
        ("scene0", "scannet"),
    ):
        if any(word in part.lower() for part in words):
            return "habitat" if convention == "habitat" else "scannet"
    expected = "scannet or habitat: the folder's name does not tell whose axes and depth unit its frames have"
    raise InputError(uri, field="convention", expected=expected, found="neither")


def _stem(name: str, ending: str) -> str:
    """Return the frame's name where the file is its image of this kind, else an empty text."""
    stem, suffix = posixpath.splitext(name)
    return stem.removesuffix(ending) if suffix.lower() in IMAGE_ENDINGS and stem.endswith(ending) else ""


def _flat(uri: str, names: tuple[str, ...]) -> tuple[list[FrameFiles], str]:
    images = {_stem(n, "-rgb"): join(uri, n) for n in names if _stem(n, "-rgb")}
    depths = {_stem(n, "-depth"): join(uri, n) for n in names if _stem(n, "-depth")}
    poses = frozenset(names)
    files = [
        FrameFiles(
            stem, join(uri, f"{stem}.txt") if f"{stem}.txt" in poses else None, images.get(stem), depths.get(stem)
        )
        for stem in sorted(images.keys() | depths.keys())
    ]
    return files, uri


def _nested(uri: str) -> tuple[list[FrameFiles], str]:
    """Return the frames of color/, depth/ and pose/; ScanNet's numbers have no leading zeros."""
    color = next((join(uri, f) for f in COLOR_FOLDERS if exists(join(uri, f))), join(uri, COLOR_FOLDERS[0]))
    found: list[dict[str, str]] = []
    for folder, endings in ((color, IMAGE_ENDINGS), (join(uri, "depth"), (".png",)), (join(uri, "pose"), (".txt",))):
        split = [posixpath.splitext(n) for n in list_files(folder)]
        found.append({stem: join(folder, stem + suffix) for stem, suffix in split if suffix.lower() in endings})
    images, depths, poses = found
    stems = sorted(images.keys() | depths.keys(), key=lambda s: (int(s), s) if s.isdecimal() else (-1, s))
    files = [FrameFiles(s, poses.get(s), images.get(s), depths.get(s)) for s in stems]
    intrinsics = join(uri, "intrinsic")
    return files, intrinsics if exists(intrinsics) else uri


def _square_pixels(lens: Lens, subject: str) -> tuple[Lens, list[str]]:
    """Return the lens with fy as Habitat renders, where it was written by the rule that gets it wrong."""
    fx, fy = float(lens.K[0, 0]), float(lens.K[1, 1])
    horizontal = 2 * np.arctan(lens.width / (2 * fx))
    written = lens.height / 2 / np.tan(horizontal * lens.height / lens.width / 2)
    if abs(fy - fx) <= _BUGGY_FOCAL_TOLERANCE * fx or abs(fy - written) > _BUGGY_FOCAL_TOLERANCE * written:
        return lens, []
    K = lens.K.copy()
    K[1, 1] = fx
    return replace(lens, K=K), [f"{subject}: fy {fy:.1f} mended to {fx:.1f}, Habitat renders square pixels"]
