"""Making scenes: from meshes and captures to Gaussians with categories."""

from pipeline.construct.mesh.scannet_mesh import ScannetScene, build_scannet_mesh

__all__ = ["ScannetScene", "build_scannet_mesh"]
