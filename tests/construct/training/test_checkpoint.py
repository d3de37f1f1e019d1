from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.construct.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from schemas.errors import InputError


def _checkpoint(step: int) -> Checkpoint:
    return Checkpoint("run", {"step": step, "history": []}, {"value.means": np.arange(6, dtype=np.float32) / 3})


def test_what_was_saved_comes_back_bit_for_bit(tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "train.npz"
    save_checkpoint(path, _checkpoint(1))
    save_checkpoint(path, _checkpoint(2))
    loaded = load_checkpoint(path, "run")
    assert loaded is not None
    assert loaded.head == {"step": 2, "history": []}
    assert np.array_equal(loaded.arrays["value.means"], _checkpoint(2).arrays["value.means"])
    assert [file.name for file in path.parent.iterdir()] == ["train.npz"]


def test_without_a_file_there_is_nothing_to_go_on_from(tmp_path: Path) -> None:
    assert load_checkpoint(tmp_path / "none.npz", "run") is None


def test_a_half_written_file_beside_it_does_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "train.npz"
    save_checkpoint(path, _checkpoint(1))
    path.with_name("train.npz.0.part").write_bytes(path.read_bytes()[:100])
    loaded = load_checkpoint(path, "run")
    assert loaded is not None
    assert loaded.head["step"] == 1
    save_checkpoint(path, _checkpoint(2))


def test_another_runs_file_is_refused(tmp_path: Path) -> None:
    save_checkpoint(tmp_path / "train.npz", _checkpoint(1))
    with pytest.raises(InputError, match="another run's"):
        load_checkpoint(tmp_path / "train.npz", "other")


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:60] + b"XX" + b[62:]])
def test_a_damaged_file_is_refused_by_name(tmp_path: Path, damage: object) -> None:
    path = tmp_path / "train.npz"
    save_checkpoint(path, _checkpoint(1))
    assert callable(damage)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=r"train\.npz.*whole checkpoint"):
        load_checkpoint(path, "run")


def test_every_flipped_byte_of_the_arrays_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "train.npz"
    save_checkpoint(path, _checkpoint(1))
    whole, values = path.read_bytes(), _checkpoint(1).arrays["value.means"].tobytes()
    start = whole.index(values)
    for offset in range(len(values)):
        path.write_bytes(whole[: start + offset] + bytes([whole[start + offset] ^ 1]) + whole[start + offset + 1 :])
        with pytest.raises(InputError):
            load_checkpoint(path, "run")


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError, match="checkpoints that can be written"):
        save_checkpoint(tmp_path / "file" / "train.npz", _checkpoint(1))
