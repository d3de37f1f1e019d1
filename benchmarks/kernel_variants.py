"""The renderer with other kernels, each in a process of its own that draws and times frames when it is asked to."""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from benchmarks.knobs import Knob, Turned
from pipeline.geometry import Camera
from pipeline.scene.gaussians import Gaussians


@dataclass(frozen=True, slots=True)
class Variant:
    """What is decided when kernels are compiled."""

    name: str
    tile: int = 16
    """Side of a tile, pixels: 16 or 8."""
    degree: int = 5
    """Of the polynomial that stands for 2^x."""


EXACT_KERNELS = Variant("exact kernels")
VARIANTS = (
    Variant("tile size 8 x 8", tile=8),
    Variant("exp degree 3", degree=3),
    Variant("exp degree 4", degree=4),
    Variant("exp degree 6", degree=6),
)


class VariantProcess:
    """A running variant; answers like `Turned`."""

    def __init__(self, variant: Variant, connection: Connection) -> None:
        self.name, self._connection = variant.name, connection

    def ask(self, question: str) -> None:
        """Let the process begin."""
        self._connection.send(question)

    def answer(self) -> dict | np.ndarray:
        """Wait for what `ask` began."""
        try:
            return self._connection.recv()
        except EOFError:
            sys.exit(f"{self.name}: the process ended, see above")

    def frames(self) -> dict[str, np.ndarray]:
        """Colour and dominance of every view."""
        self.ask("frames")
        return self.answer()

    def times(self) -> np.ndarray:
        """CPU milliseconds, (2, views): colour, dominance."""
        self.ask("times")
        return self.answer()


@contextmanager
def variant_processes(
    variants: Sequence[Variant], scene: Gaussians, cameras: list[Camera]
) -> Iterator[list[VariantProcess]]:
    """Processes that have compiled and hold the prepared scene; they end with the context."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        started, found = [], []
        try:
            for variant in variants:
                ours, theirs = context.Pipe()
                cache = os.path.join(folder, variant.name)
                process = context.Process(target=serve, args=(variant, cache, scene, cameras, theirs), daemon=True)
                process.start()
                theirs.close()
                started.append(process)
                found.append(VariantProcess(variant, ours))
            for process in found:  # all compile side by side
                process.ask("times")
            for process in found:
                process.answer()
            yield found
        finally:
            for process in started:
                process.terminate()
                process.join()


def serve(variant: Variant, cache: str, scene: Gaussians, cameras: list[Camera], questions: Connection) -> None:
    """Answer questions until the other end goes away."""
    # numba's cache knows files, not what was replaced in them: a variant's kernels must not reach anyone else.
    if "numba" in sys.modules:
        sys.exit("numba was imported before its cache folder was chosen")
    os.environ["NUMBA_CACHE_DIR"] = cache
    from benchmarks.variant_kernels import take_effect

    take_effect(variant.tile, variant.degree)
    turned = Turned(Knob(variant.name), scene, cameras)
    while True:
        try:
            question = questions.recv()
        except EOFError:
            return
        questions.send(turned.frames() if question == "frames" else turned.times())
