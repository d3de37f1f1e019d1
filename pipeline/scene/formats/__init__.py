"""Splat files: each reader gives the same raw parameters."""
