from __future__ import annotations

from dataclasses import asdict, replace

import pandas as pd
import pytest

from jobs.scoring.cluster_scores import cluster_summary
from schemas.clusterings import ClusteringRow

CHAIRS = ClusteringRow("q0", "a", "chair", 1000, 0.2, 5, 100, 900, 4, 0.5, 1, 0, 3)


def _frame(*rows: ClusteringRow) -> pd.DataFrame:
    return pd.DataFrame([asdict(row) for row in rows], columns=list(ClusteringRow.__dataclass_fields__))


def test_a_category_counts_once_in_a_scene_however_many_questions_ask_for_it() -> None:
    once, often = _frame(CHAIRS), _frame(CHAIRS, replace(CHAIRS, question_id="q1"), replace(CHAIRS, question_id="q2"))
    pd.testing.assert_frame_equal(cluster_summary(once, "category"), cluster_summary(often, "category"))


def test_cluster_summary_means_and_sums_what_has_ground_truth() -> None:
    other = replace(CHAIRS, scene="b", ari=1.0, clusters=2, instances=2, matched=2, over_split=0, dropped=0)
    blind = replace(
        CHAIRS, scene="c", known=0, ari=None, instances=None, over_split=None, under_split=None, matched=None
    )
    found = cluster_summary(_frame(CHAIRS, other, blind), "category")
    assert found["category"].tolist() == ["chair", "all"]
    for row in found.to_dict("records"):
        assert (row["clusterings"], row["scored"], row["ari"]) == (3, 2, 0.75)
        assert (row["clusters"], row["instances"], row["matched"]) == (7, 6, 5)
        assert (row["over_split"], row["under_split"]) == (1, 0)
        assert row["dropped"] == pytest.approx(200 / 3000)
    by_scene = cluster_summary(_frame(CHAIRS, other, blind), "scene").set_index("scene")
    assert by_scene["scored"].to_dict() == {"a": 1, "b": 1, "c": 0, "all": 2}
    assert pd.isna(by_scene["ari"]["c"])


def test_cluster_summary_of_nothing_has_no_row() -> None:
    assert cluster_summary(_frame(), "scene").empty
