"""Text embeddings that belong to a scene's features: `text_embeddings.npz`, a vector for each name a query may use.

The names are those of the vocabulary and, for LERF relevancy, the canonical phrases. Whoever made the per-Gaussian
features has the text side of the same model; the file carries its output, so that a job needs no such model.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from schemas import storage
from schemas.errors import InputError

FILE = "text_embeddings.npz"


@dataclass(frozen=True, slots=True)
class TextEmbeddings:
    """Vectors by name.

    Raises:
        InputError: Names repeat, or a vector is missing, zero or not finite.
    """

    names: tuple[str, ...]
    """Category names and phrases."""
    vectors: Float[np.ndarray, "T D"]
    """One vector a name, any non-zero norm."""
    model: str = ""
    """Model that made them, for the record; empty where the file does not say."""

    def __post_init__(self) -> None:
        if len(self.names) != len(self.vectors) or len(set(self.names)) != len(self.names):
            found = f"{len(set(self.names))} distinct names, {len(self.vectors)} vectors"
            raise InputError(FILE, expected="one vector for each of distinct names", found=found)
        usable = np.isfinite(self.vectors).all(axis=1) & (self.vectors != 0).any(axis=1)
        if not usable.all():
            name = self.names[int(np.argmin(usable))]
            raise InputError(FILE, field=name, expected="a finite vector that is not zero", found="another")

    def encode(self, texts: Sequence[str]) -> Float[np.ndarray, "T D"]:
        """Return the vectors of names, in the order asked for.

        Raises:
            InputError: A name has none.
        """
        missing = [text for text in texts if text not in self.names]
        if missing:
            raise InputError(
                FILE, field="names", expected=f"the name {missing[0]!r}", found=f"{len(self.names)} others"
            )
        return self.vectors[[self.names.index(text) for text in texts]]


def read_text_embeddings(uri: str) -> TextEmbeddings:
    """Return the embeddings in an NPZ file with `names` (T,), `vectors` (T, D), and `model`, a text, where known.

    Raises:
        InputError: The file is no such NPZ, or its content is not usable. Pickled objects are refused.
        RetryError: A remote store failed to answer.
    """
    data = storage.read_bytes(uri)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            names, vectors = arrays["names"], arrays["vectors"]
            model = str(arrays["model"]) if "model" in arrays.files else ""
    except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(uri, expected="an NPZ file with `names` and `vectors`", found=str(error)) from error
    if names.dtype.kind != "U" or names.ndim != 1 or vectors.dtype.kind != "f" or vectors.ndim != 2:
        found = f"names {names.dtype} {names.shape}, vectors {vectors.dtype} {vectors.shape}"
        raise InputError(uri, expected="names as T texts and vectors as T x D floats", found=found)
    try:
        return TextEmbeddings(tuple(names.tolist()), vectors.astype(np.float32), model)
    except InputError as error:
        raise InputError(uri, field=error.field, expected=error.expected, found=error.found) from error


def text_embeddings_npz(embeddings: TextEmbeddings) -> bytes:
    """Return the content of a `text_embeddings.npz`."""
    stream = io.BytesIO()
    np.savez(stream, names=np.array(embeddings.names), vectors=embeddings.vectors, model=np.array(embeddings.model))
    return stream.getvalue()
