"""CLIP by the transformers library: features of images and of texts in one space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from pipeline.construct.semantics.labels_2d.torch_models import load_pretrained, require


class ClipModel:
    """Both sides of a CLIP model.

    Args:
        name: Local folder or hub name.
        device: Torch device.

    Raises:
        InputError: A library is missing, or the model cannot be loaded.
    """

    def __init__(self, name: str, device: str = "cpu") -> None:
        self._model: Any = load_pretrained("CLIPModel", name).to(device).eval()
        self._processor: Any = load_pretrained("CLIPProcessor", name)
        self._device = device
        self.model = name
        """Name of the model, for the scene's record."""
        self.dimension = int(self._model.config.projection_dim)
        """Size D of its features."""

    def images(self, images: Sequence[UInt8[np.ndarray, "_ _ 3"]]) -> Float32[np.ndarray, "K D"]:
        """Return the unit feature of each sRGB image."""
        with require("torch").inference_mode():
            inputs = self._processor(images=list(images), return_tensors="pt").to(self._device)
            return _unit(self._model.get_image_features(**inputs))

    def encode(self, texts: Sequence[str]) -> Float32[np.ndarray, "T D"]:
        """Return the unit feature of each text."""
        with require("torch").inference_mode():
            inputs = self._processor(text=list(texts), padding=True, truncation=True, return_tensors="pt")
            return _unit(self._model.get_text_features(**inputs.to(self._device)))


def _unit(features: Any) -> Float32[np.ndarray, "K D"]:
    # Newer versions of the library wrap the features in an output object.
    rows = getattr(features, "pooler_output", features).float().cpu().numpy()
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.finfo(np.float32).tiny)
