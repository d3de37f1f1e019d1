"""Splat files: each reader gives the same raw parameters."""

from pipeline.scene.formats.read import GaussiansFile, load_gaussians, read_gaussians, save_gaussians

__all__ = ["GaussiansFile", "load_gaussians", "read_gaussians", "save_gaussians"]
