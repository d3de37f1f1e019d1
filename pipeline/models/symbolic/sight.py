"""Views that were perceived, by what decides them: an image is asked about by several stages and several questions."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable

from pipeline.models.messages import ImagePart
from pipeline.models.symbolic.perceive import perceive
from pipeline.models.symbolic.view import View


class Sight:
    """Perceives images and keeps the most recently used views.

    Args:
        kept: Most views kept, about 100 kB each.
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
    """Return a key of all that decides what is perceived: pixels, categories, depth, lens, up and names."""
    # Without an observation nothing is perceived, whatever the pixels.
    return None if image.observation is None else image.sha256()
