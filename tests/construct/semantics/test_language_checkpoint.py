"""Checkpoints of language fields: tensors are read, anything else is refused and nothing in the file is run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.baselines.field_file import read_field
from pipeline.construct.semantics.language_checkpoint import FEATURES, FIELDS, XYZ, read_language_checkpoint
from schemas.errors import InputError
from tests.query.tiny import tiny_scene

torch = pytest.importorskip("torch")


def _save(path: Path, **changed: Any) -> str:
    model = [0.0] * FIELDS
    model[XYZ] = changed.pop("xyz", torch.zeros(4, 3))
    model[FEATURES] = changed.pop("features", torch.arange(8.0).reshape(4, 2))
    torch.save(changed.pop("content", (tuple(model), 0)), path)
    return str(path)


def test_features_and_centres_are_read(tmp_path: Path) -> None:
    found = read_language_checkpoint(_save(tmp_path / "chkpnt0.pth"))
    assert found.features.tolist() == np.arange(8.0).reshape(4, 2).tolist()
    assert found.means.shape == (4, 3)


class _Runs:
    """What a hostile file holds: unpickling it would make a folder."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


def test_a_file_that_would_run_something_is_refused(tmp_path: Path) -> None:
    path = _save(tmp_path / "c.pth", content=((_Runs(tmp_path / "made"),) * FIELDS, 0))
    with pytest.raises(InputError, match="expected tensors and plain values alone; export the features to NPZ"):
        read_language_checkpoint(path)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"content": {"a": 1}}, "expected a checkpoint .* found dict"),
        ({"content": ((0,) * 12, 0)}, "expected a checkpoint"),
        ({"features": torch.zeros(4, 130, dtype=torch.uint8)}, "found quantised codes"),
        ({"features": torch.zeros(5, 2)}, "expected a checkpoint"),
        ({"features": 1.0}, "found no tensor of two axes there"),
    ],
)
def test_another_checkpoint_is_refused(tmp_path: Path, changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_language_checkpoint(_save(tmp_path / "c.pth", **changed))


def test_what_is_no_checkpoint_is_refused(tmp_path: Path) -> None:
    (tmp_path / "c.pth").write_bytes(b"text")
    for path in (tmp_path / "c.pth", tmp_path / "none.pth"):
        with pytest.raises(InputError):
            read_language_checkpoint(str(path))


def test_a_checkpoint_must_be_of_the_scenes_own_gaussians(tmp_path: Path) -> None:
    scene = tiny_scene()
    means = torch.from_numpy(scene.gaussians.means.copy())
    features = torch.ones(len(means), 2)
    found = read_field(_save(tmp_path / "c.pth", xyz=means, features=features), scene)
    assert found.features is not None
    assert found.features.shape == (len(means), 2)
    with pytest.raises(InputError, match="expected the Gaussians of tiny in their order, found other centres"):
        read_field(_save(tmp_path / "c.pth", xyz=means.flip(0), features=features), scene)
