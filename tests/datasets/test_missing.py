"""Missing scenes: found in the data sets' own folders, named with what to download."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.datasets import find_scene, load_dataset_questions, missing_scenes
from schemas.questions import Question


def question(scene: str, number: int = 0) -> Question:
    return Question(f"{scene}-{number}", scene, "eqa", "What?")


@pytest.mark.parametrize(
    ("scene", "folder"),
    [
        ("002-scannet-scene0709_00", "002-scannet-scene0709_00"),
        ("002-scannet-scene0709_00", "scannet-v0/002-scannet-scene0709_00"),
        ("002-scannet-scene0709_00", "scans_test/scene0709_00"),
        ("000-hm3d-BFRyYbPCCPE", "frames/hm3d-v0/000-hm3d-BFRyYbPCCPE"),
        ("scene0011_00", "scans/scene0011_00"),
        ("00824-Dd4bFSTQ8gi", "hm3d/val/00824-Dd4bFSTQ8gi"),
        ("my flat", "my flat"),
    ],
)
def test_scenes_are_found_in_the_folders_of_their_data_set(tmp_path: Path, scene: str, folder: str) -> None:
    roots = [str(tmp_path / "empty"), str(tmp_path / "data")]
    assert find_scene(scene, roots) is None
    (tmp_path / "data" / folder).mkdir(parents=True)
    assert find_scene(scene, roots) == str(tmp_path / "data" / folder)
    assert missing_scenes([question(scene)], roots) == ()


@pytest.mark.parametrize(
    ("scene", "dataset", "words"),
    [
        (
            "002-scannet-scene0709_00",
            "OpenEQA, ScanNet half",
            ["Terms of Use", "scene0709_00.sens", "first 600 frames"],
        ),
        ("000-hm3d-BFRyYbPCCPE", "OpenEQA, HM3D half", ["Matterport's terms", "RGB only"]),
        ("scene0011_00", "ScanNet", ["Terms of Use", "http://www.scan-net.org"]),
        ("00824-Dd4bFSTQ8gi", "HM3D", ["aihabitat.org"]),
        ("my flat", "your own", ["put the folder there"]),
    ],
)
def test_a_missing_scene_says_what_to_download(tmp_path: Path, scene: str, dataset: str, words: list[str]) -> None:
    (missing,) = missing_scenes([question(scene), question(scene, 1)], [str(tmp_path)])
    assert (missing.scene, missing.questions, missing.dataset) == (scene, 2, dataset)
    assert missing.looked_in[0] == str(tmp_path / scene)
    line = str(missing)
    assert line.startswith(f"{scene}: 2 questions; expected at {tmp_path / scene}; {dataset}")
    assert not [word for word in words if word not in line]
    assert "{" not in line


def test_missing_scenes_are_listed_once_by_name(tmp_path: Path) -> None:
    questions = [question(scene, i) for i, scene in enumerate(["b", "a", "b", "c"])]
    (tmp_path / "c").mkdir()
    assert [(m.scene, m.questions) for m in missing_scenes(questions, [str(tmp_path)])] == [("a", 1), ("b", 2)]
    with pytest.raises(ValueError, match="at least one root"):
        missing_scenes(questions, [])


def test_every_official_scene_is_known_to_a_data_set(shared_data: Path, tmp_path: Path) -> None:
    openeqa = load_dataset_questions("openeqa", str(shared_data / "openeqa/open-eqa-v0.json"))
    scanrefer = load_dataset_questions("scanrefer", str(shared_data / "scanrefer/scanrefer_val.json"))
    missing = missing_scenes([*openeqa, *scanrefer], [str(tmp_path)])
    assert len(missing) == 152 + 141
    assert {m.dataset for m in missing} == {"OpenEQA, ScanNet half", "OpenEQA, HM3D half", "ScanNet"}
    assert sum(m.questions for m in missing) == 1636 + 9498
