"""What other language fields wrote for the Gaussians of a scene: features or scores, in the order of the PLY file."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pipeline.scene.scene import Scene
from schemas import storage
from schemas.errors import InputError
from schemas.questions import Question

SHAPE = "an NPZ file with `scores` (M, or Q x M with `names`) or `features` (M x D)"
SAME_M = 1e-3
"""Centres of a checkpoint may differ from the scene's by this much, metres: then its order is the scene's."""


@dataclass(frozen=True, slots=True)
class FieldFile:
    """One file's content; features or scores."""

    features: Float[np.ndarray, "M D"] | None
    """A feature per Gaussian, zero where it is not valid."""
    scores: Float[np.ndarray, "Q M"] | None
    """A score per query and Gaussian."""
    names: tuple[str, ...]
    """Of each query: its question's id or text; empty where the file is for one question."""
    valid: Bool[np.ndarray, "M"]
    """Gaussians that the field knows."""

    def scores_of(self, question: Question, uri: str) -> Float[np.ndarray, "M"]:
        """Return the scores of a question.

        Raises:
            InputError: The file has none for it.
        """
        assert self.scores is not None
        if not self.names:
            return self.scores[0]
        for name in (question.question_id, question.question):
            if name in self.names:
                return self.scores[self.names.index(name)]
        expected = f"the id or text of question {question.question_id!r}"
        raise InputError(uri, field="names", expected=expected, found=f"{len(self.names)} others")


def read_field(uri: str, scene: Scene) -> FieldFile:
    """Return what a file says of a scene's Gaussians.

    Raises:
        InputError: The file is missing or wrong, or has another number of Gaussians than the scene. Pickled objects are
            refused.
        RetryError: A remote store failed to answer.
    """
    found = _checkpoint(uri, scene) if uri.endswith((".pth", ".pt")) else _npz(uri)
    if len(found.valid) != len(scene.gaussians):
        expected = f"{len(scene.gaussians)} rows, one a Gaussian of {scene.name} as loaded"
        raise InputError(uri, expected=expected, found=len(found.valid))
    return found


def _npz(uri: str) -> FieldFile:
    data = storage.read_bytes(uri)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            held = {name: arrays[name] for name in arrays.files if name in ("features", "scores", "names", "valid")}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(uri, expected=SHAPE, found=str(error)) from error
    if ("features" in held) == ("scores" in held):
        raise InputError(uri, expected=SHAPE, found=", ".join(sorted(held)) or "neither")
    values = held.get("features", held.get("scores"))
    assert values is not None
    if values.dtype.kind != "f" or values.ndim not in (1, 2) or ("features" in held and values.ndim == 1):
        raise InputError(uri, expected=SHAPE, found=f"{values.dtype} {values.shape}")
    names = _names(uri, held, values)
    count = values.shape[0] if "features" in held else values.shape[-1]
    valid = held.get("valid", np.ones(count, bool))
    if valid.dtype != bool or valid.shape != (count,):
        raise InputError(uri, field="valid", expected=f"{count} booleans", found=f"{valid.dtype} {valid.shape}")
    if "scores" in held:
        scores = np.atleast_2d(values)
        if not np.isfinite(scores[:, valid]).all():
            raise InputError(uri, field="scores", expected="finite numbers where valid", found="others")
        return FieldFile(None, scores, names, valid)
    return FieldFile(_usable(uri, values, valid), None, (), valid)


def _names(uri: str, held: dict[str, np.ndarray], values: np.ndarray) -> tuple[str, ...]:
    if "features" in held or values.ndim == 1:
        return ()
    names = held.get("names")
    if names is None or names.dtype.kind != "U" or names.shape != values.shape[:1]:
        found = "none" if names is None else f"{names.dtype} {names.shape}"
        raise InputError(uri, field="names", expected=f"{len(values)} texts, one a row of scores", found=found)
    return tuple(names.tolist())


def _checkpoint(uri: str, scene: Scene) -> FieldFile:
    from pipeline.construct.semantics.language_checkpoint import read_language_checkpoint

    checkpoint = read_language_checkpoint(uri)
    means = scene.gaussians.means
    if checkpoint.means.shape == means.shape and not np.allclose(checkpoint.means, means, atol=SAME_M):
        raise InputError(uri, expected=f"the Gaussians of {scene.name} in their order", found="other centres")
    valid = np.ones(len(checkpoint.features), bool)
    return FieldFile(_usable(uri, checkpoint.features, valid), None, (), valid)


def _usable(uri: str, features: np.ndarray, valid: np.ndarray) -> np.ndarray:
    if not np.isfinite(features[valid]).all():
        raise InputError(uri, field="features", expected="finite numbers where valid", found="others")
    return np.where(valid[:, None], features, np.zeros((), features.dtype))
