"""Features of LangSplat, Dr. Splat and OpenGaussian files made here, by their formats."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.construct.semantics.imports import ImportConfig, read_dr_splat, read_langsplat, read_opengaussian
from pipeline.construct.semantics.language_checkpoint import FEATURES, FIELDS, XYZ
from schemas.errors import InputError
from tests.query.tiny import gaussians_at

torch = pytest.importorskip("torch")

MEANS = np.arange(12, dtype=np.float32).reshape(4, 3)
FLOAT16 = 1e-3


def checkpoint(path: Path, features: Any) -> str:
    model = [0.0] * FIELDS
    model[XYZ], model[FEATURES] = torch.from_numpy(MEANS), features
    torch.save((tuple(model), 30000), path)
    return str(path)


def autoencoder(path: Path, sizes: tuple[int, ...] = (3, 8, 16), **extra: Any) -> str:
    torch.manual_seed(0)
    state = {"encoder.0.weight": torch.zeros(8, 16), "encoder.0.bias": torch.zeros(8)}
    for k, (i, o) in enumerate(pairwise(sizes)):
        state |= {f"decoder.{2 * k}.weight": torch.randn(o, i), f"decoder.{2 * k}.bias": torch.randn(o)}
    torch.save(state | extra, path)
    return str(path)


def test_langsplat_codes_are_decoded_as_torch_does(tmp_path: Path) -> None:
    codes = torch.tensor([[1.0, 2, 3], [0, 0, 0], [-4, 0, 2], [0.1, 0.1, 0.5]])
    path = autoencoder(tmp_path / "best_ckpt.pth")
    found = read_langsplat(checkpoint(tmp_path / "c.pth", codes), path)
    state = torch.load(path, weights_only=True)
    unit = torch.nn.functional.normalize(codes, dim=1)
    hidden = torch.relu(unit @ state["decoder.0.weight"].T + state["decoder.0.bias"])
    expected = torch.nn.functional.normalize(hidden @ state["decoder.2.weight"].T + state["decoder.2.bias"], dim=1)
    embedding = found.embedding(gaussians_at(MEANS))
    assert found.valid.tolist() == [True, False, True, True]
    np.testing.assert_allclose(embedding[found.valid], expected.numpy()[found.valid], atol=FLOAT16)
    assert not embedding[1].any()


def test_langsplat_files_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    good = checkpoint(tmp_path / "c.pth", torch.ones(4, 3))
    with pytest.raises(InputError, match="expected codes of 5 numbers"):
        read_langsplat(good, autoencoder(tmp_path / "a.pth", (5, 16)))
    broken = autoencoder(
        tmp_path / "b.pth", **{"decoder.4.weight": torch.zeros(4, 9), "decoder.4.bias": torch.zeros(4)}
    )
    with pytest.raises(InputError, match=r"decoder.4: expected layers that follow each other, found 9 inputs after 16"):
        read_langsplat(good, broken)
    torch.save({"encoder.0.weight": torch.zeros(2, 2)}, tmp_path / "e.pth")
    with pytest.raises(InputError, match="found no decoder"):
        read_langsplat(good, str(tmp_path / "e.pth"))


def test_dr_splat_features_come_as_they_are(tmp_path: Path) -> None:
    features = torch.tensor([[3.0, 4], [0, 0], [1, 0], [0, 2]])
    found = read_dr_splat(checkpoint(tmp_path / "c.pth", features))
    expected = [[0.6, 0.8], [0, 0], [1, 0], [0, 1]]
    np.testing.assert_allclose(found.embedding(gaussians_at(MEANS)), expected, atol=FLOAT16)


def test_dr_splat_codes_are_decoded_with_their_codebooks(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cells, parts = rng.normal(size=(300, 8)).astype(np.float32), rng.normal(size=(4, 256, 2)).astype(np.float32)
    np.savez(tmp_path / "books.npz", cells=cells, parts=parts)
    codes = rng.integers(0, 255, (4, 6)).astype(np.uint8)
    codes[0, :2], codes[1], codes[2, :2], codes[3, :2] = (43, 1), 255, (7, 0), (0, 1)
    found = read_dr_splat(checkpoint(tmp_path / "c.pth", torch.from_numpy(codes)), str(tmp_path / "books.npz"))
    assert found.valid.tolist() == [True, False, True, True]
    for row, cell in ((0, 299), (2, 7), (3, 256)):
        expected = cells[cell] + np.concatenate([parts[p, codes[row, 2 + p]] for p in range(4)])
        np.testing.assert_allclose(found.features[row], expected, rtol=1e-6)


def test_dr_splat_codes_alone_or_with_other_codebooks_are_refused(tmp_path: Path) -> None:
    path = checkpoint(tmp_path / "c.pth", torch.zeros(4, 6, dtype=torch.uint8))
    with pytest.raises(InputError, match="found quantised codes"):
        read_dr_splat(path)
    np.savez(tmp_path / "b.npz", cells=np.zeros((9, 8), np.float32), parts=np.zeros((4, 256, 2), np.float32))
    with pytest.raises(InputError, match="expected codes of 5 bytes"):
        read_dr_splat(path, str(tmp_path / "b.npz"))
    np.savez(tmp_path / "p.npz", cells=np.array([{}], object), parts=np.zeros(3, np.float32))
    with pytest.raises(InputError, match="expected an NPZ file with cells, parts"):
        read_dr_splat(path, str(tmp_path / "p.npz"))


def opengaussian(path: Path, **changed: Any) -> str:
    arrays = {
        "leaf_feat": np.array([[3.0, 4], [1, 0], [5, 5]], np.float32),
        "leaf_score": np.ones(3, np.float32),
        "occu_count": np.array([5.0, 1, 9], np.float32),
        "leaf_ind": np.array([0, 1, 3, 2]),
    }
    np.savez(path, **{**arrays, **changed})
    return str(path)


def test_opengaussian_clusters_give_their_feature(tmp_path: Path) -> None:
    found = read_opengaussian(opengaussian(tmp_path / "cluster_lang.npz"))
    # The second cluster was described by one view only; the third Gaussian is in no cluster.
    assert found.valid.tolist() == [True, False, False, True]
    half = np.sqrt(0.5)
    expected = [[0.6, 0.8], [0, 0], [0, 0], [half, half]]
    np.testing.assert_allclose(found.embedding(gaussians_at(MEANS)), expected, atol=FLOAT16)


@pytest.mark.parametrize(
    "changed",
    [
        {"leaf_ind": np.array([0, 1, 4, 2])},
        {"leaf_ind": np.array([0.5, 1, 1, 2])},
        {"leaf_ind": np.array([], int)},
        {"occu_count": np.ones(2)},
        {"leaf_feat": np.array([1, 2, 3])},
    ],
)
def test_opengaussian_files_that_make_no_sense_are_refused(tmp_path: Path, changed: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        read_opengaussian(opengaussian(tmp_path / "c.npz", **changed))


def test_features_of_other_gaussians_are_refused(tmp_path: Path) -> None:
    found = ImportConfig(kind="dr_splat", file=checkpoint(tmp_path / "{c}.pth", torch.ones(4, 2))).read()
    with pytest.raises(InputError, match="expected the scene's Gaussians in their order, found other centres"):
        found.embedding(gaussians_at(MEANS + 1))
    with pytest.raises(InputError, match="expected 3 Gaussians, as in the scene, found 4"):
        found.embedding(gaussians_at(MEANS[:3]))


def test_features_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected finite numbers where valid"):
        read_dr_splat(checkpoint(tmp_path / "c.pth", torch.full((4, 2), float("nan"))))
