"""Captures and camera files: each loader converts to OpenCV world-to-camera poses and metres at the door."""

from pipeline.scene.captures.capture import Capture, Frame, Skipped, SparsePoints
from pipeline.scene.captures.colmap import read_colmap
from pipeline.scene.captures.frame_folder import read_frame_folder
from pipeline.scene.captures.nerfstudio import read_nerfstudio, transforms_json
from pipeline.scene.captures.open_capture import CaptureKind, open_capture
from pipeline.scene.captures.reconstruction import read_colmap_capture, read_nerfstudio_capture
from pipeline.scene.captures.select_frames import select_frames
from pipeline.scene.captures.sens import read_sens
from pipeline.scene.captures.seven_scenes import read_seven_scenes
from pipeline.scene.captures.views_file import ViewsFile

__all__ = [
    "Capture",
    "CaptureKind",
    "Frame",
    "Skipped",
    "SparsePoints",
    "ViewsFile",
    "open_capture",
    "read_colmap",
    "read_colmap_capture",
    "read_frame_folder",
    "read_nerfstudio",
    "read_nerfstudio_capture",
    "read_sens",
    "read_seven_scenes",
    "select_frames",
    "transforms_json",
]
