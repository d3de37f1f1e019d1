"""Which frames of a capture are kept from fitting, so that a scene can be measured on what it has not seen."""

from __future__ import annotations

import numpy as np

from pipeline.scene.captures import Capture, Frame


def split_held_out(capture: Capture, every: int | None, most: int) -> tuple[Capture, tuple[Frame, ...]]:
    """Return the capture without the frames that are kept from fitting, and those to measure on.

    Args:
        capture: All usable frames.
        every: Of every so many frames the last is kept from fitting: 5 keeps numbers 4, 9, 14, ...; None keeps none.
        most: Kept frames with a photograph that are measured, spread evenly; the others are left out of both.
    """
    if every is None or len(capture) < every:
        return capture, ()
    kept = capture.frames[every - 1 :: every]
    names = {frame.name for frame in kept}
    fitted = capture.only(frame.name for frame in capture.frames if frame.name not in names)
    shown = [frame for frame in kept if frame.image is not None]
    measured = np.unique(np.linspace(0, len(shown) - 1, min(most, len(shown))).round().astype(int)).tolist()
    return fitted, tuple(shown[index] for index in measured)
