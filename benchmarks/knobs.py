"""The knobs that trade error for time, each a `RenderQuality` or a change of the scene, and a scene with one turned."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from pipeline.geometry import Camera
from pipeline.render import EXACT, FAST, RenderQuality, prepare, render
from pipeline.scene.gaussians import Gaussians

COLOR, DOMINANCE = ("color", "depth", "alpha"), ("dominant",)


@dataclass(frozen=True, slots=True)
class Knob:
    """One way to trade error for time."""

    name: str
    quality: RenderQuality = EXACT
    half: tuple[str, ...] = ()
    """Attributes rounded to float16."""


KNOBS = (
    Knob("exact"),
    Knob("preset fast", FAST),
    Knob("resolution 3/4", RenderQuality(scale=0.75)),
    Knob("resolution 1/2", RenderQuality(scale=0.5)),
    Knob("resolution 1/3", RenderQuality(scale=1 / 3)),
    Knob("resolution 1/4", RenderQuality(scale=0.25)),
    Knob("SH degree 2", RenderQuality(sh_degree=2)),
    Knob("SH degree 1", RenderQuality(sh_degree=1)),
    Knob("SH degree 0", RenderQuality(sh_degree=0)),
    Knob("opacity >= 0.02", RenderQuality(min_opacity=0.02)),
    Knob("opacity >= 0.05", RenderQuality(min_opacity=0.05)),
    Knob("opacity >= 0.1", RenderQuality(min_opacity=0.1)),
    Knob("opacity >= 0.2", RenderQuality(min_opacity=0.2)),
    Knob("float16 scale, turn, opacity", half=("quats", "log_scales", "opacity_logits")),
    Knob("float16 colour", half=("sh",)),
    Knob("float16 means", half=("means",)),
    Knob("alpha >= 2/255", RenderQuality(alpha_min=2 / 255)),
    Knob("alpha >= 4/255", RenderQuality(alpha_min=4 / 255)),
    Knob("alpha >= 8/255", RenderQuality(alpha_min=8 / 255)),
    Knob("stop at T < 1e-3", RenderQuality(transmittance_stop=1e-3)),
    Knob("stop at T < 1e-2", RenderQuality(transmittance_stop=1e-2)),
    Knob("stop at T < 4e-2", RenderQuality(transmittance_stop=4e-2)),
    Knob("alpha 2/255, T 1e-2", RenderQuality(alpha_min=2 / 255, transmittance_stop=1e-2)),
    Knob("alpha 4/255, T 4e-2", RenderQuality(alpha_min=4 / 255, transmittance_stop=4e-2)),
    Knob("fast at 1/2", FAST.model_copy(update={"scale": 0.5})),
)


class Turned:
    """A scene with one knob turned: its frames, and how long they take."""

    def __init__(self, knob: Knob, scene: Gaussians, cameras: list[Camera]) -> None:
        arrays = {name: getattr(scene, name) for name in ("means", "quats", "log_scales", "opacity_logits", "sh")}
        for name in knob.half:
            arrays[name] = arrays[name].astype(np.float16).astype(np.float32)
        self._prepared, self._quality, self._cameras = prepare(Gaussians(**arrays)), knob.quality, cameras

    def _draw(self, camera: Camera, outputs: tuple[str, ...]):
        return render(self._prepared, camera, outputs, quality=self._quality)

    def frames(self) -> dict[str, np.ndarray]:
        """Colour and dominance of every view on the full grid."""
        color = [self._draw(camera, COLOR).color for camera in self._cameras]
        dominant = [self._draw(camera, DOMINANCE).dominant for camera in self._cameras]
        return {"color": np.array(color), "dominant": np.array(dominant)}

    def times(self) -> np.ndarray:
        """CPU milliseconds, (2, views): colour, dominance."""
        spent = np.zeros((2, len(self._cameras)))
        for mode, outputs in enumerate((COLOR, DOMINANCE)):
            for view, camera in enumerate(self._cameras):
                start = time.thread_time()
                self._draw(camera, outputs)
                spent[mode, view] = 1e3 * (time.thread_time() - start)
        return spent
