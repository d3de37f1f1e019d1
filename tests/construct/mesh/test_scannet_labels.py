"""ScanNet annotation files: the labels they give, and one clear line for each way they can be wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.construct.mesh.scannet_labels import read_axis_alignment, read_labels
from schemas.errors import InputError

SEGMENTS: dict[str, Any] = {"sceneId": "a", "segIndices": [7, 7, 3, 9, 3]}
GROUPS: dict[str, Any] = {
    "sceneId": "scannet.a",
    "segGroups": [
        {"objectId": 4, "label": "lamp", "segments": [3]},
        {"objectId": 0, "label": "desk ", "segments": [7]},
    ],
}


def write(folder: Path, segments: object = SEGMENTS, groups: object = GROUPS) -> tuple[Path, Path]:
    first, second = folder / "a.segs.json", folder / "a.aggregation.json"
    first.write_text(json.dumps(segments))
    second.write_text(json.dumps(groups))
    return first, second


def test_labels_follow_segments_to_objects(tmp_path: Path) -> None:
    labels = read_labels(*write(tmp_path), 5)
    assert labels.vocabulary == ("desk", "lamp")
    assert labels.category.tolist() == [0, 0, 1, -1, 1]
    assert labels.instance.tolist() == [0, 0, 4, -1, 4]
    assert labels.names == {0: "desk", 4: "lamp"}
    assert labels.warnings == ()


def test_a_segment_claimed_twice_stays_with_the_first_and_is_told(tmp_path: Path) -> None:
    groups = {**GROUPS, "segGroups": [*GROUPS["segGroups"], {"objectId": 5, "label": "cup", "segments": [3]}]}
    labels = read_labels(*write(tmp_path, groups=groups), 5)
    assert labels.instance.tolist() == [0, 0, 4, -1, 4]
    assert "cup" not in labels.vocabulary
    assert len(labels.warnings) == 2


def changed(record: dict[str, Any], **values: object) -> dict[str, Any]:
    return {k: v for k, v in {**record, **values}.items() if v is not None}


@pytest.mark.parametrize(
    ("segments", "groups", "said"),
    [
        (changed(SEGMENTS, segIndices=None), GROUPS, "segIndices: expected a list, found no such field"),
        (changed(SEGMENTS, segIndices=[7, 7, 3]), GROUPS, "segIndices: expected 5 entries"),
        (changed(SEGMENTS, segIndices=[7, 7, 3, 9, "3"]), GROUPS, "segIndices: expected whole numbers"),
        (changed(SEGMENTS, sceneId="b"), GROUPS, "sceneId: expected b"),
        (SEGMENTS, changed(GROUPS, segGroups=None), "segGroups: expected a list"),
        (SEGMENTS, changed(GROUPS, segGroups=[{"objectId": 0, "segments": []}]), "segGroups[0]: label"),
        (SEGMENTS, changed(GROUPS, segGroups=[{"label": "x", "segments": []}]), "segGroups[0]: objectId"),
        (
            SEGMENTS,
            changed(GROUPS, segGroups=[GROUPS["segGroups"][0]] * 2),
            "segGroups[1]: objectId: expected an id no",
        ),
        (SEGMENTS, changed(GROUPS, segGroups=[{"objectId": 1, "label": "x", "segments": [8]}]), "segments of a.segs"),
        (SEGMENTS, changed(GROUPS, segGroups=["x"]), "segGroups[0]: expected a group"),
        ([], GROUPS, "a JSON object"),
    ],
)
def test_read_labels_names_what_is_wrong(tmp_path: Path, segments: object, groups: object, said: str) -> None:
    with pytest.raises(InputError) as caught:
        read_labels(*write(tmp_path, segments, groups), 5)
    assert said in str(caught.value)


def test_read_labels_names_a_missing_or_broken_file(tmp_path: Path) -> None:
    first, second = write(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        read_labels(first, tmp_path / "none.json", 5)
    second.write_text("{")
    with pytest.raises(InputError, match=r"aggregation\.json: expected JSON"):
        read_labels(first, second, 5)


def test_axis_alignment_is_the_turn_about_the_vertical_axis_or_none(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    cos, sin = np.cos(0.4), np.sin(0.4)
    path.write_text(f"axisAlignment = {cos} {-sin} 0 1 {sin} {cos} 0 2 0 0 1 0 0 0 0 1\ncolorWidth = 3\n")
    assert read_axis_alignment(path) == pytest.approx(0.4)
    path.write_text("colorWidth = 3\n")
    assert read_axis_alignment(path) is None


@pytest.mark.parametrize("value", ["1 2 3", "a b", "1 0 0 0 0 0 1 0 0 1 0 0 0 0 0 1"])
def test_axis_alignment_that_is_no_turn_is_refused(tmp_path: Path, value: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text(f"axisAlignment = {value}\n")
    with pytest.raises(InputError, match="axisAlignment"):
        read_axis_alignment(path)
    with pytest.raises(InputError, match="no such file"):
        read_axis_alignment(tmp_path / "b.txt")
