"""7-Scenes sequences: `frame-000000.color.png`, `.depth.png`, `.pose.txt`; depth in mm, 0 and 65535 invalid.

The data set gives one lens for both images and says they are not calibrated: taken at its word, the photographs lie up
to 40 pixels off the depth. Their own lens and place below were fitted to the red kitchen (docs/datasets.md).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.scene.captures.capture import Capture, Frame
from pipeline.scene.captures.image_files import MILLIMETRE_M
from pipeline.scene.captures.posed_files import DepthRule, FrameFiles, Lens, posed_frames, read_lens
from schemas.errors import InputError
from schemas.storage import join, list_files, name_of

INTRINSICS = "camera-intrinsics.txt"
"""Not part of the official download; used where someone put it there."""
DEFAULT_K = np.array([[585.0, 0, 320.0], [0, 585.0, 240.0], [0, 0, 1.0]])
"""What the data set's page gives for all its sequences, of 640 x 480 pixels."""
COLOR_K = np.array([[526.2, 0, 323.0], [0, 526.2, 236.2], [0, 0, 1.0]])
"""Lens of the photographs, fitted."""
COLOR_FROM_DEPTH_M = np.array([-0.0326, 0.0058, 0.0])
"""What is added to a point in the depth camera's axes to have it in the photograph's, fitted."""
DEPTH = DepthRule(MILLIMETRE_M, (0, 65535))


def read_seven_scenes(uri: str, *, register: bool = True, name: str = "") -> Capture:
    """Return the capture of one sequence; poses are camera-to-world in OpenCV axes, and where up is is not known.

    Args:
        uri: Folder with the frames, such as redkitchen/seq-01.
        register: Give the photographs their own lens and place, where the intrinsics are the data set's; False leaves
            them those of the depth.
        name: Scene name; empty takes the folder's.

    Raises:
        InputError: The folder has no frames, its intrinsics are wrong, or no pose is usable.
    """
    uri = str(uri)
    names = frozenset(list_files(uri))
    stems = sorted({n.split(".")[0] for n in names if n.startswith("frame-")})
    files = []
    for stem in stems:
        image = next((f"{stem}.color{s}" for s in (".png", ".jpg") if f"{stem}.color{s}" in names), None)
        depth, pose = (n if n in names else None for n in (f"{stem}.depth.png", f"{stem}.pose.txt"))
        files.append(FrameFiles(stem, *(None if n is None else join(uri, n) for n in (pose, image, depth))))
    if not files:
        raise InputError(uri, expected="a 7-Scenes sequence (frame-000000.color.png, ...)", found="no frames")
    notes: tuple[str, ...] = ()
    if INTRINSICS in names:
        lens = read_lens(join(uri, INTRINSICS), next((f.image or f.depth for f in files if f.image or f.depth), None))
    else:
        lens = Lens(DEFAULT_K, 640, 480)
        notes = (f"no {INTRINSICS}: taken as the data set's page has it, f 585 at 640 x 480",)
    frames, skipped = posed_frames(files, lens, None, DEPTH, opengl=False)
    if register and (lens.width, lens.height) == (640, 480) and np.allclose(lens.K, DEFAULT_K, atol=0.5):
        frames = tuple(_registered(frame) for frame in frames)
        notes = (*notes, "photographs have a lens and a place of their own, fitted: f 526.2, 33 mm beside the depth")
    return Capture(name or name_of(uri), frames, skipped, notes)


def _registered(frame: Frame) -> Frame:
    pose = frame.camera.world_to_camera.copy()
    pose[:, 3] += COLOR_FROM_DEPTH_M
    return replace(frame, camera=replace(frame.camera, K=COLOR_K, world_to_camera=pose), depth_camera=frame.camera)
