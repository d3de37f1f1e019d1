"""Questions with answers computed from the geometry of known objects."""
