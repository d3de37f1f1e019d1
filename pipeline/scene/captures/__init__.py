"""Camera files: each loader converts to OpenCV world-to-camera poses at the door."""

from pipeline.scene.captures.colmap import read_colmap
from pipeline.scene.captures.nerfstudio import read_nerfstudio, transforms_json
from pipeline.scene.captures.views_file import ViewsFile

__all__ = ["ViewsFile", "read_colmap", "read_nerfstudio", "transforms_json"]
