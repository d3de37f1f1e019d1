"""What training tells while it runs and afterwards. Imports no torch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipeline.construct.photos.register_photos import register_photos
from pipeline.metrics.image_quality import depth_errors, psnr, ssim
from pipeline.render import PreparedGaussians, prepare, render
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame


@dataclass(frozen=True, slots=True)
class HeldOutQuality:
    """Rendered frames that training never saw against what was recorded: means over these frames."""

    frames: int
    """Frames compared."""
    psnr: float
    """dB."""
    ssim: float
    """Structural similarity, at most 1."""
    depth_abs_m: float | None
    """Mean |depth error|, metres, by the depth camera's own lens; None where no frame has depth."""
    depth_within_5cm: float | None
    """Share of measured pixels whose rendered depth is within 5 cm."""
    aligned_psnr: float | None = None
    """PSNR, dB, once each photograph's pose is fitted to the scene, six numbers; None where that was not looked at."""
    aligned_ssim: float | None = None
    """SSIM at these poses."""
    exposed_psnr: float | None = None
    """PSNR, dB, at these poses once each photograph's exposure is fitted, too: a gain and an offset per channel."""


@dataclass(frozen=True, slots=True)
class TrainProgress:
    """Where training stands."""

    step: int
    """Steps done."""
    steps: int
    """Steps there are at most."""
    share: float
    """Share of the run that is done, by steps or by time, whichever is more; 0 to 1."""
    seconds: float
    """Time spent training, all sessions together; looks at held-out frames not included."""
    gaussians: int
    """M."""
    scale: float
    """Scale of the images in the last step."""
    loss: float | None
    """Mean loss since the last report; None at the start."""
    psnr: float | None
    """Mean PSNR, dB, of the images looked at since then, at that scale; None at the start."""
    held_out: HeldOutQuality | None = None
    """Quality on held-out frames, where it was looked at."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, nested as they are here."""
        return asdict(self)

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> TrainProgress:
        """Return what `as_dict` gave."""
        held_out = values["held_out"]
        return TrainProgress(**{**values, "held_out": held_out and HeldOutQuality(**held_out)})


def held_out_quality(
    gaussians: Gaussians,
    frames: Sequence[Frame],
    *,
    aligned: bool = False,
    threads: int = 1,
    progress: Callable[[float], object] = lambda share: None,
) -> HeldOutQuality:
    """Return how near renderings are to frames that were held out.

    Args:
        gaussians: The scene.
        frames: At least one, with photographs.
        aligned: Whether to look at them again at poses fitted to the scene: where photographs are out of step with
            their poses, these cap what any scene can reach as recorded. The other figures are not touched by it.
        threads: Threads inside a frame.
        progress: Told the share that is done, 0 to 1.
    """
    prepared = prepare(gaussians)
    quality, depth = [], []
    looks = (2 if aligned else 1) * len(frames)
    for number, frame in enumerate(frames):
        progress(number / looks)
        photo = frame.read_image()
        color = render(prepared, frame.camera, ("color",), threads=threads).color
        assert color is not None, "it was asked for"
        quality.append((psnr(color, photo), ssim(color, photo)))
        if frame.depth is not None:
            rendered = render(prepared, frame.depth_lens, ("depth",), threads=threads).depth
            assert rendered is not None, "it was asked for"
            errors = depth_errors(rendered, frame.read_depth())
            depth.append((errors.mean_abs_m, errors.within_5cm * errors.covered))
    mean_psnr, mean_ssim = np.mean(quality, axis=0)
    fits: tuple[float | None, float | None, float | None] = (None, None, None)
    if aligned:
        moved = register_photos(
            gaussians,
            frames,
            centered=False,
            threads=threads,
            progress=lambda done: progress((len(frames) + done) / looks),
        ).frames
        fits = _mean([_aligned(prepared, frame, threads) for frame in moved])
    depth_abs_m, within = np.nanmean(depth, axis=0) if depth else (None, None)
    return HeldOutQuality(
        len(frames),
        float(mean_psnr),
        float(mean_ssim),
        None if depth_abs_m is None else float(depth_abs_m),
        None if within is None else float(within),
        *fits,
    )


def _aligned(prepared: PreparedGaussians, frame: Frame, threads: int) -> tuple[float, float, float]:
    """Return PSNR and SSIM at a frame's own pose, and PSNR after a gain and an offset per channel."""
    photo = frame.read_image()
    color = render(prepared, frame.camera, ("color",), threads=threads).color
    assert color is not None, "it was asked for"
    exposed = np.empty_like(color)
    for channel in range(3):
        ours, theirs = color[..., channel], photo[..., channel] / 255.0
        mean = ours.mean()
        gain = ((ours - mean) * theirs).sum() / max(float(((ours - mean) ** 2).sum()), 1e-12)
        exposed[..., channel] = theirs.mean() + gain * (ours - mean)
    return psnr(color, photo), ssim(color, photo), psnr(exposed, photo)


def _mean(rows: list[tuple[float, float, float]]) -> tuple[float, float, float]:
    first, second, third = np.mean(rows, axis=0)
    return float(first), float(second), float(third)
