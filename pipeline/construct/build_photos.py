"""Photographs of a build put where the fused scene says they were taken, and whether that is worth it.

A photograph fits a scene better wherever it is moved to: its own residual says little. So a trial is judged on
photographs that its scenes have not seen: a run of neighbouring frames is fused twice, before and after its photographs
were moved, and each of the frames between them that were left out is put where it fits each scene best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.construct.fuse import fuse
from pipeline.construct.fuse_config import FusionConfig
from pipeline.construct.register_photos import register_photos
from pipeline.scene import Gaussians
from pipeline.scene.captures import Capture, Frame

RUN = 24
"""Neighbouring frames of the trial, from the middle of the capture: they see the same things."""
JUDGE_EVERY = 4
"""Of every so many frames of the trial the last is left out and judges."""
LEAST_FRAMES = 8
"""Frames below which there is no trial: two judges."""
LEAST_GAIN = 0.01
"""Share by which the judges' residuals must fall. On the 7-Scenes kitchen they fall by PLACE; where poses are right
they rise, since the photographs follow the noise of the depth."""


@dataclass(frozen=True, slots=True)
class PhotoTrial:
    """What came of moving some photographs."""

    frames: int
    """Frames that judged, unseen by either scene."""
    gain: float
    """Share by which their residuals fell, at poses fitted to each scene; negative where they rose."""

    @property
    def pays(self) -> bool:
        """Whether to move them all."""
        return self.gain >= LEAST_GAIN


def try_photos(
    frames: Sequence[Frame], config: FusionConfig, *, progress: Callable[[float], object] | None = None
) -> PhotoTrial | None:
    """Return what moving the photographs of a run of frames brings, or None where there are too few to tell.

    Args:
        frames: A capture's frames, in the order they were taken.
        config: How depth becomes Gaussians; its threads are used throughout.
        progress: Told the share that is done, 0 to 1.
    """
    usable = [frame for frame in frames if frame.image is not None and frame.depth is not None]
    first = max(0, (len(usable) - RUN) // 2)
    run = usable[first : first + RUN]
    judges = run[JUDGE_EVERY - 1 :: JUDGE_EVERY]
    fitted = [frame for number, frame in enumerate(run, start=1) if number % JUDGE_EVERY]
    if len(run) < LEAST_FRAMES:
        return None
    total, done = 3 * len(fitted) + 2 * len(judges), 0

    def tell(further: float) -> None:
        if progress is not None:
            progress(min(1.0, (done + further) / total))

    def judged(shown: Sequence[Frame]) -> tuple[Gaussians, float]:
        nonlocal done
        gaussians = fuse(shown, config, progress=lambda share: tell(share * len(shown))).gaussians
        done += len(shown)
        fits = register_photos(gaussians, judges, centered=False, threads=config.threads, progress=tell)
        done += len(judges)
        return gaussians, float(fits.error_after.mean())

    gaussians, before = judged(fitted)
    moved = register_photos(gaussians, fitted, threads=config.threads, progress=tell).frames
    done += len(fitted)
    _, after = judged(moved)
    # A judge that sees hardly anything has no finite residual.
    return PhotoTrial(len(judges), 1.0 - after / before if 0.0 < before < np.inf else 0.0)


def place_photos(
    capture: Capture, gaussians: Gaussians, *, threads: int = 1, progress: Callable[[int], object] | None = None
) -> tuple[Capture, int]:
    """Return the capture with each photograph's camera where the scene fits it best, and how many were moved.

    Args:
        capture: Frames; depth keeps its lens and pose.
        gaussians: The scene that fusing these frames gave.
        threads: Frames side by side.
        progress: Called with the number of frames done.
    """
    found = register_photos(gaussians, capture.frames, threads=threads, progress=progress)
    return replace(capture, frames=found.frames), int(np.count_nonzero(found.moved_m + found.turned_rad))
