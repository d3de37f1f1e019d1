"""Label images: ids become places in the vocabulary, and a file that is no such image says so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.construct.semantics.labels_2d.label_files import LabelFilesConfig, read_ids, write_names
from pipeline.scene.captures import Frame
from schemas.errors import InputError
from tests.query.tiny import camera_at

FRAME = Frame("0007", camera_at((0, 0, 1), (0, 1, 1), 4, 3))
IDS = np.array([[0, 1, 1, 0], [5, 5, 1, 0], [0, 0, 0, 5]], np.uint8)


def folder(tmp_path: Path, names: object, ids: np.ndarray = IDS) -> Path:
    (tmp_path / "names.json").write_text(json.dumps(names))
    Image.fromarray(ids).save(tmp_path / "0007.label.png")
    return tmp_path


def test_ids_index_the_names(tmp_path: Path) -> None:
    where = folder(tmp_path, {"1": "chair", "5": "table"})
    source = LabelFilesConfig(folder=str(where), nothing=(0,)).open()
    assert source.vocabulary == ("chair", "table")
    assert source.labels(FRAME).category.tolist() == [[-1, 0, 0, -1], [1, 1, 0, -1], [-1, -1, -1, 1]]


def test_two_ids_of_one_name_are_one_category(tmp_path: Path) -> None:
    where = folder(tmp_path, {"0": "wall", "1": "chair", "5": "chair"})
    source = LabelFilesConfig(folder=str(where)).open()
    assert source.vocabulary == ("wall", "chair")
    assert (source.labels(FRAME).category == (IDS > 0)).all()


def test_names_that_were_written_are_read(tmp_path: Path) -> None:
    write_names(("wall", "chair"), tmp_path)
    assert LabelFilesConfig(folder=str(tmp_path)).open().vocabulary == ("wall", "chair")


@pytest.mark.parametrize("kind", ["png", "npy"])
def test_instances_of_16_bits_and_more_are_read(tmp_path: Path, kind: str) -> None:
    things = (IDS.astype(np.int32) * 1000 - 1) if kind == "npy" else IDS.astype(np.uint16) * 1000
    if kind == "npy":
        np.save(tmp_path / "0007.npy", things)
    else:
        Image.fromarray(things).save(tmp_path / "0007.png")
    where = folder(tmp_path, ["nothing", "a", "b", "c", "d", "e"])
    source = LabelFilesConfig(folder=str(where), instance="{frame}." + kind, nothing=(0,)).open()
    found = source.labels(FRAME).instance
    assert found is not None
    assert found[1].tolist() == ([4999, 4999, 999, -1] if kind == "npy" else [5000, 5000, 1000, -1])


def test_the_scenes_name_stands_in_the_path(tmp_path: Path) -> None:
    (tmp_path / "kitchen").mkdir()
    folder(tmp_path / "kitchen", ["a", "b", "c", "d", "e", "f"])
    source = LabelFilesConfig(folder=str(tmp_path / "{scene}")).open("kitchen")
    assert source.labels(FRAME).category[1, 0] == 5


def test_an_id_without_a_name_is_refused(tmp_path: Path) -> None:
    source = LabelFilesConfig(folder=str(folder(tmp_path, ["wall", "chair"]))).open()
    with pytest.raises(InputError, match=r"0007.label.png: id 5: expected a name in names.json"):
        source.labels(FRAME)


@pytest.mark.parametrize("names", ["chair", [], [1, 2], {"a": "chair"}, [""]])
def test_names_that_are_none_are_refused(tmp_path: Path, names: object) -> None:
    with pytest.raises(InputError, match=r"names.json: expected a JSON list of names by id"):
        LabelFilesConfig(folder=str(folder(tmp_path, names))).open()


def test_colour_images_and_other_files_are_refused(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((3, 4, 3), np.uint8)).save(tmp_path / "colour.png")
    (tmp_path / "text.png").write_text("no image")
    np.save(tmp_path / "float.npy", np.zeros((3, 4)))
    for name in ("colour.png", "text.png", "float.npy"):
        with pytest.raises(InputError, match=r"expected an image of one channel"):
            read_ids(str(tmp_path / name))
    with pytest.raises(InputError):
        read_ids(str(tmp_path / "missing.png"))


def test_instances_of_another_size_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "0007.npy", np.zeros((2, 2), np.int32))
    where = folder(tmp_path, ["a", "b", "c", "d", "e", "f"])
    with pytest.raises(InputError, match=r"expected the size \(3, 4\)"):
        LabelFilesConfig(folder=str(where), instance="{frame}.npy").open().labels(FRAME)
