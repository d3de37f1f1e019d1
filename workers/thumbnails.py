"""Small pictures of the views that were considered, for the report. They are no result: a lost one costs nothing."""

from __future__ import annotations

import io
import os
import uuid
from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8

from schemas import storage

LONG_SIDE = 256
"""Pixels of the longer side: a view is recognisable, and a thousand of them stay under 10 MB."""
QUALITY = 80


def encode_thumbnail(color: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """Return the image, scaled to LONG_SIDE at most, as JPEG."""
    from PIL import Image

    image = Image.fromarray(color)
    image.thumbnail((LONG_SIDE, LONG_SIDE))
    sink = io.BytesIO()
    image.save(sink, "JPEG", quality=QUALITY)
    return sink.getvalue()


def save_thumbnails(run: str, images: Mapping[str, UInt8[np.ndarray, "H W 3"]]) -> int:
    """Write the images that are not there yet; return how many were written.

    Args:
        run: Run folder.
        images: RGB by path below the run folder. The path tells the content, so an existing file is left alone.
    """
    written = 0
    for name, color in images.items():
        uri = storage.join(run, *name.split("/"))
        if storage.exists(uri):
            continue
        data, path = encode_thumbnail(color), storage.local_path(uri)
        if path is None:
            storage.write_bytes_atomic(uri, data)
        else:
            # Renamed so that no reader meets half a picture, but not synced: it can be made again.
            path.parent.mkdir(parents=True, exist_ok=True)
            aside = path.with_name(f".{uuid.uuid4().hex}.tmp")
            aside.write_bytes(data)
            os.replace(aside, path)
        written += 1
    return written
