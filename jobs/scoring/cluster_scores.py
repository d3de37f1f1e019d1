"""Cluster quality of a run: each scene and evidence category counts once, however many questions asked for it."""

from __future__ import annotations

import pandas as pd

COUNTS = ("instances", "matched", "over_split", "under_split")


def cluster_summary(clusterings: pd.DataFrame, by: str) -> pd.DataFrame:
    """Return one row a group and one, named "all", for the run: the mean ARI and sums of counts.

    Args:
        clusterings: Table `clusterings`.
        by: Column that makes a group: category or scene.

    Returns:
        clusterings: scenes and categories clustered (once for each config, where methods differ in it); scored: those
        with ground truth; ari: their mean, None for none; clusters, instances, matched, over_split, under_split: sums
        over the scored; dropped: share of all activated Gaussians in no cluster, None where nothing was activated.
    """
    each = clusterings.drop(columns="question_id").drop_duplicates()
    groups = [(str(name), group) for name, group in each.groupby(by, sort=True)]
    found = []
    for name, group in [*groups, ("all", each)] if len(each) else []:
        scored = group[group["ari"].notna()]
        activated = int(group["activated"].sum())
        found.append(
            {
                by: name,
                "clusterings": len(group),
                "scored": len(scored),
                "ari": float(scored["ari"].astype(float).mean()) if len(scored) else None,
                "clusters": int(scored["clusters"].sum()),
                **{column: int(scored[column].sum()) for column in COUNTS},
                "dropped": int(group["dropped"].sum()) / activated if activated else None,
            }
        )
    return pd.DataFrame(found, columns=[by, "clusterings", "scored", "ari", "clusters", *COUNTS, "dropped"])
