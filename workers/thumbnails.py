"""Small pictures of the views that were considered, for the report. They are no result: a lost one costs nothing."""

from __future__ import annotations

import io
import os
import uuid
from collections.abc import Mapping
from contextlib import suppress

import numpy as np
from jaxtyping import UInt8

from schemas import storage
from schemas.errors import StopError

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

    Raises:
        StopError: The disk takes no more.
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
            aside = path.with_name(f".{uuid.uuid4().hex}.tmp")
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                aside.write_bytes(data)
                os.replace(aside, path)
            except OSError as error:
                # The disk's fault, and no question's.
                with suppress(OSError):
                    aside.unlink(missing_ok=True)
                raise StopError(f"{path.parent}: {error.strerror}: mend that, then resume") from error
        written += 1
    return written
