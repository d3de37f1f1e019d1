"""3DGS optimisation: rasteriser, losses, optimiser, density control, checkpoints, progress."""
