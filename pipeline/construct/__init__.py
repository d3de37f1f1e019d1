"""Making scenes: from meshes and captures to Gaussians with categories."""
