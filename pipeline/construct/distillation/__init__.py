"""Ground truth on Gaussians, from labelled point clouds and meshes."""
