"""Photographs of a build put where the fused scene says they were taken, and whether that is worth it.

A photograph fits a scene better wherever it is moved to: its own residual says little. So a trial is judged on
photographs that its scenes have not seen: a run of neighbouring frames is fused twice, before and after its photographs
were moved, and each of the frames between them that were left out is put where it fits each scene best.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pipeline.construct.fusion.fuse import fuse
from pipeline.construct.fusion.fuse_config import FusionConfig
from pipeline.construct.photos.register_photos import register_photos
from pipeline.scene import Gaussians
from pipeline.scene.captures import Capture, Frame

RUN = 24
"""Neighbouring frames of the trial, from the middle of the capture: they see the same things."""
JUDGE_EVERY = 4
"""Of every so many frames of the trial the last is left out and judges."""
LEAST_FRAMES = 16
"""Frames below which there is no trial: four judges."""
LEAST_GAIN = 0.02
"""Mean share by which the judges' residuals must fall. In three runs of the 7-Scenes kitchen, its photographs 4 to
6 pixels out of step, they fall by 3.0 to 3.6 %; in three of a generated apartment with exact poses and noisy depth by
-0.2 to 1.4 %, though its photographs, too, fit their scene 3 % better once they are moved."""
SURE = 2.0
"""Standard errors by which that mean must be above zero: few judges differ by chance."""


@dataclass(frozen=True, slots=True)
class PhotoTrial:
    """What came of moving some photographs."""

    falls: Float[np.ndarray, "J"]
    """Share by which the residual of each judge, a frame that no scene was made of, fell at poses fitted to each scene;
    negative where it rose."""

    @property
    def gain(self) -> float:
        """Mean over the judges."""
        return float(self.falls.mean())

    @property
    def pays(self) -> bool:
        """Whether to move all photographs; never where a judge has no residual, since it sees hardly anything."""
        error = float(self.falls.std(ddof=1)) / np.sqrt(len(self.falls))
        return bool(self.gain >= LEAST_GAIN and self.gain >= SURE * error)


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

    def tell(further: int | float) -> None:
        if progress is not None:
            progress(min(1.0, (done + further) / total))

    def judged(shown: Sequence[Frame]) -> tuple[Gaussians, Float[np.ndarray, "J"]]:
        nonlocal done
        gaussians = fuse(shown, config, progress=lambda share: tell(share * len(shown))).gaussians
        done += len(shown)
        fits = register_photos(gaussians, judges, centered=False, threads=config.threads, progress=tell)
        done += len(judges)
        return gaussians, fits.error_after

    gaussians, before = judged(fitted)
    moved = register_photos(gaussians, fitted, threads=config.threads, progress=tell).frames
    done += len(fitted)
    _, after = judged(moved)
    with np.errstate(invalid="ignore", divide="ignore"):
        return PhotoTrial(1.0 - after / before)


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
