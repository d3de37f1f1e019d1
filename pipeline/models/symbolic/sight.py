"""Views that were perceived, by what decides them: an image is asked about by several stages and several questions."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable

import numpy as np

from pipeline.models.messages import ImagePart
from pipeline.models.symbolic.perceive import View, perceive

WORD = 8
"""Bytes of a word that is fingerprinted at once."""


class Sight:
    """Perceives images and keeps the most recently used views.

    Args:
        kept: Most views kept, about 10 kB each.
    """

    def __init__(self, kept: int) -> None:
        self._kept = kept
        self._views: OrderedDict[Hashable, View] = OrderedDict()
        self.perceived = 0
        """Images looked at."""
        self.recalled = 0
        """Images whose view was kept."""

    def view(self, image: ImagePart) -> View:
        """Return what an image shows; images of equal content share it."""
        key = content_key(image)
        view = self._views.pop(key, None)
        if view is None:
            view = perceive(image)
            self.perceived += 1
        else:
            self.recalled += 1
        self._views[key] = view
        if len(self._views) > self._kept:
            self._views.popitem(last=False)
        return view


def content_key(image: ImagePart) -> Hashable:
    """Return a key of all that decides what is perceived: pixels, categories, depth, lens, up and names.

    Every byte is read at every call: a key kept with an image would outlive a change of its arrays.
    """
    seen = image.observation
    if seen is None:  # nothing is perceived, whatever the pixels
        return None
    arrays = (image.color, seen.category, seen.depth, seen.K, seen.up)
    return *map(_fingerprint, arrays), seen.vocabulary


def _fingerprint(array: np.ndarray) -> Hashable:
    from pipeline.models.symbolic.digest_kernels import fingerprint

    data = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
    if len(data) <= 16 * WORD:
        return array.shape, array.dtype.char, data.tobytes()
    whole = len(data) // WORD * WORD
    return array.shape, array.dtype.char, fingerprint(data[:whole].view(np.uint64), data[whole:])
