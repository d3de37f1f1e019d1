"""LangSplat: three numbers a Gaussian in its checkpoint, and the scene's own decoder from these to CLIP's 512."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from pipeline.construct.semantics.imports.features import ROWS_AT_ONCE, ImportedFeatures
from pipeline.construct.semantics.language_checkpoint import load_tensors, read_language_checkpoint
from schemas.errors import InputError

EXPECTED = "the state dict of a LangSplat autoencoder: weights and biases of decoder.0, decoder.2, ..."


def read_langsplat(checkpoint: str, autoencoder: str) -> ImportedFeatures:
    """Return the decoded features of one level of a LangSplat scene.

    Its code is normalised before decoding, as its training does; the decoder is linear layers with ReLU between.

    Args:
        checkpoint: `chkpnt30000.pth` of one level.
        autoencoder: `best_ckpt.pth` of the scene.

    Raises:
        InputError: A file is wrong, or the two do not fit.
    """
    found = read_language_checkpoint(checkpoint)
    layers = _decoder(autoencoder)
    if layers[0][0].shape[1] != found.features.shape[1]:
        expected = f"codes of {layers[0][0].shape[1]} numbers, as the decoder takes"
        raise InputError(checkpoint, field="features", expected=expected, found=found.features.shape[1])
    norms = np.linalg.norm(found.features, axis=1)
    valid = norms > 0
    features = np.zeros((len(valid), len(layers[-1][1])), np.float16)
    for start in range(0, len(valid), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        out = found.features[rows] / np.where(norms[rows] > 0, norms[rows], 1)[:, None]
        for number, (weight, bias) in enumerate(layers):
            out = (np.maximum(out, 0) if number else out) @ weight.T + bias
        # Unit norm before 16 bits: a decoder's raw output may leave their range.
        features[rows] = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), np.finfo(np.float32).tiny)
    return ImportedFeatures(features, valid, found.means, checkpoint)


def _decoder(path: str) -> list[tuple[Float32[np.ndarray, "o i"], Float32[np.ndarray, "o"]]]:
    """Return weight and bias of the decoder's layers, first to last."""
    state = load_tensors(path)
    if not isinstance(state, dict):
        raise InputError(path, expected=EXPECTED, found=type(state).__name__)
    numbers = sorted(
        int(name.split(".")[1]) for name in state if name.startswith("decoder.") and name.endswith(".weight")
    )
    layers: list[tuple[Float32[np.ndarray, "o i"], Float32[np.ndarray, "o"]]] = []
    for number in numbers:
        weight, bias = (state.get(f"decoder.{number}.{part}") for part in ("weight", "bias"))
        if weight is None or bias is None or weight.ndim != 2 or bias.shape != weight.shape[:1]:
            raise InputError(path, field=f"decoder.{number}", expected=EXPECTED, found="another layer")
        if layers and weight.shape[1] != len(layers[-1][1]):
            found = f"{weight.shape[1]} inputs after {len(layers[-1][1])} outputs"
            raise InputError(path, field=f"decoder.{number}", expected="layers that follow each other", found=found)
        layers.append((weight.float().numpy(), bias.float().numpy()))
    if not layers:
        raise InputError(path, expected=EXPECTED, found="no decoder")
    return layers
