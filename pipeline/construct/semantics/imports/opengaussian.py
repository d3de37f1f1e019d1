"""OpenGaussian: a cluster for every Gaussian, and one CLIP feature a cluster."""

from __future__ import annotations

import numpy as np

from pipeline.construct.semantics.imports.features import ImportedFeatures, read_npz
from schemas.errors import InputError

LEAST_VIEWS = 2
"""Views that must have described a cluster: its own evaluation drops those of one."""


def read_opengaussian(clusters: str) -> ImportedFeatures:
    """Return the features of an OpenGaussian scene, in the order of its PLY file.

    A cluster that fewer than two views described (`occu_count`) has no feature, nor has a Gaussian whose cluster is
    the number of clusters.

    Args:
        clusters: `cluster_lang.npz` with `leaf_feat` (C, D), `leaf_ind` (M,) and `occu_count` (C,).

    Raises:
        InputError: The file is wrong.
    """
    arrays = read_npz(clusters, {"leaf_feat": "f", "leaf_ind": "iuf", "occu_count": "iuf"})
    features, leaf, count = arrays["leaf_feat"], arrays["leaf_ind"].reshape(-1), arrays["occu_count"].reshape(-1)
    if features.ndim != 2 or len(count) != len(features):
        found = f"{features.shape} and {count.shape}"
        raise InputError(clusters, field="leaf_feat", expected="(C, D), and C of occu_count", found=found)
    index = leaf.astype(np.int64)
    if (index != leaf).any() or len(leaf) == 0 or index.min() < -1 or index.max() > len(features):
        expected = f"whole numbers from -1 to {len(features)}, one a Gaussian"
        raise InputError(clusters, field="leaf_ind", expected=expected, found=f"{leaf.dtype}, {leaf.shape}")
    described = (count >= LEAST_VIEWS) & np.isfinite(features).all(axis=1) & (features != 0).any(axis=1)
    known = (index >= 0) & (index < len(features))
    index[~known] = 0
    return ImportedFeatures(features[index], known & described[index], None, clusters)
