"""One door for every capture: the format is found by what a folder holds, or named."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from pipeline.scene.captures.capture import Capture
from pipeline.scene.captures.frame_folder import read_frame_folder
from pipeline.scene.captures.reconstruction import read_colmap_capture, read_nerfstudio_capture
from pipeline.scene.captures.sens import OPENEQA_FRAMES, read_sens
from pipeline.scene.captures.seven_scenes import read_seven_scenes
from schemas.errors import InputError
from schemas.storage import exists, join, list_files, name_of

CaptureKind = Literal["auto", "openeqa", "scannet", "hm3d", "sens", "7scenes", "nerfstudio", "colmap"]
"""Formats by name; auto finds the one."""


def open_capture(uri: str, kind: CaptureKind = "auto", *, name: str = "") -> Capture:
    """Return the capture in a folder or file; images and depth stay on disk until they are asked for.

    Args:
        uri: A frame folder, a folder with a .sens file or the file, a 7-Scenes sequence, a transforms.json or its
            folder, or a COLMAP project.
        kind: The format. openeqa takes the convention from the folder's name and the first 600 frames of a .sens
            file; scannet and hm3d name the convention of a frame folder.
        name: Scene name; empty takes the folder's.

    Raises:
        InputError: Nothing there is a capture, it is damaged, or no pose is usable.
    """
    uri = str(uri)
    readers: dict[str, Callable[[], Capture]] = {
        "openeqa": lambda: _openeqa(uri, name),
        "scannet": lambda: read_frame_folder(uri, "scannet", name=name),
        "hm3d": lambda: read_frame_folder(uri, "habitat", name=name),
        "sens": lambda: read_sens(_sens_file(uri), name=name),
        "7scenes": lambda: read_seven_scenes(uri, name=name),
        "nerfstudio": lambda: read_nerfstudio_capture(uri, name=name),
        "colmap": lambda: read_colmap_capture(uri, name=name),
        "auto": lambda: read_frame_folder(uri, name=name),
    }
    return readers[kind if kind != "auto" else _kind(uri)]()


def _kind(uri: str) -> str:
    if uri.endswith(".sens"):
        return "sens"
    if uri.endswith(".json"):
        return "nerfstudio"
    names = list_files(uri)
    if not names and not exists(uri):
        raise InputError(uri, expected="a capture (a folder of frames, or a .sens file)", found="nothing there")
    if any(n.startswith("frame-") and ".color." in n for n in names):
        return "7scenes"
    if any(n.endswith(("-rgb.png", "-rgb.jpg", "-depth.png")) for n in names) or exists(join(uri, "pose")):
        return "auto"
    if "transforms.json" in names:
        return "nerfstudio"
    if any(n.endswith(".sens") for n in names):
        return "sens"
    if "images.bin" in names or "images.txt" in names or exists(join(uri, "sparse")) or exists(join(uri, "colmap")):
        return "colmap"
    expected = "frames of OpenEQA, ScanNet, HM3D or 7-Scenes, a .sens file, transforms.json or a COLMAP model"
    found = f"{len(names)} files of none of them, such as {names[0]}" if names else "no file of any of them"
    raise InputError(uri, expected=expected, found=found)


def _openeqa(uri: str, name: str) -> Capture:
    if uri.endswith(".sens") or any(n.endswith(".sens") for n in list_files(uri)):
        return read_sens(_sens_file(uri), limit=OPENEQA_FRAMES, name=name)
    return read_frame_folder(uri, name=name)


def _sens_file(uri: str) -> str:
    if uri.endswith(".sens"):
        return uri
    found = [n for n in list_files(uri) if n.endswith(".sens")]
    if len(found) != 1:
        raise InputError(uri, expected="one .sens file", found=", ".join(found) or f"none in {name_of(uri)}")
    return join(uri, found[0])
