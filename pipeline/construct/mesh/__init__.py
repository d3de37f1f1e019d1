"""Scenes from a labelled mesh: ScanNet's files, surfels on triangles, free space and support."""
