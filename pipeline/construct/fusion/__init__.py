"""A start: depth images fused to flat Gaussians, or Gaussians at sparse points."""
