"""Semantics by direct registration: what 2D sources say of pixels, spread onto the Gaussians that painted them.

Each pixel's label goes to its heaviest Gaussians with their weights alpha * T (Dr. Splat, "feature registration"; the
paper, 3.1). Nothing is optimised: one render a view. Weights are summed sparsely, per Gaussian and label that met, so
memory grows with what was seen and not with Gaussians times labels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float16, Float32, Int32
from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.labels_2d.source import FeatureSource, LabelSource
from pipeline.construct.semantics.register_votes import PAIR_BYTES, Votes, VoteSums, frame_votes
from pipeline.geometry import Camera
from pipeline.render import PreparedGaussians, prepare
from pipeline.scene import Gaussians
from pipeline.scene.captures import Frame
from pipeline.scene.semantics import UNLABELLED
from schemas.errors import InputError

ROWS_AT_ONCE = 1 << 14
"""Gaussians whose features are added up at a time: 32 MB of float32 at D = 512."""


class RegistrationConfig(BaseModel):
    """How 2D labels and features reach the Gaussians."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    contributors: int = Field(
        default=45, ge=1, description="Heaviest Gaussians of a pixel that take its label (Dr. Splat: 45)."
    )
    first: int | None = Field(
        default=100, ge=1, description="Of a pixel's nearest so many contributions (Dr. Splat: 100); null for all."
    )
    longest_side: int | None = Field(
        default=640,
        ge=1,
        description="Label images larger than this are thinned to it, pixels; null keeps them. Contributors take "
        "8 bytes a pixel each.",
    )
    silence: float | None = Field(
        default=None,
        ge=0.0,
        allow_inf_nan=False,
        description="Weight of a pixel without a label, as a vote for no label: 0 ignores such pixels, 1 counts a "
        "detector that finds nothing as much as one that does. Null takes the source's own.",
    )
    least_weight: float = Field(
        default=1e-3,
        ge=0.0,
        allow_inf_nan=False,
        description="Summed weight, pixels, under which a Gaussian stays unlabelled: it was hardly seen.",
    )
    least_confidence: float = Field(
        default=0.0, ge=0.0, le=1.0, description="Share of its votes under which the winning label is not given."
    )
    memory_mb: int = Field(
        default=2048,
        ge=16,
        description="Bound on the sums, MiB. Where more would be needed each Gaussian's lightest labels are forgotten, "
        "and the report says how much.",
    )


@dataclass(frozen=True, slots=True)
class RegistrationReport:
    """What a registration saw."""

    frames: int
    """Frames that were registered."""
    seen: int
    """Gaussians that got weight from any pixel, labelled or not."""
    labelled: int
    """Gaussians that got a label or a feature."""
    pairs: int
    """Pairs of a Gaussian and a label at the end."""
    sums_mb: float
    """Largest size of the sums on the way, MiB."""
    forgotten: float
    """Share of all weight dropped to stay within the memory bound, 0 to 1."""
    source: str
    """The source, in its own words."""


@dataclass(frozen=True, slots=True)
class Registered:
    """A closed-set label for each of M Gaussians."""

    vocabulary: tuple[str, ...]
    """The source's."""
    category: Int32[np.ndarray, "M"]
    """Category with the largest summed weight, the first met of those tied; -1 unlabelled."""
    confidence: Float32[np.ndarray, "M"]
    """Share of that category in all votes (silence included), 0 to 1; 0 where nothing voted."""
    instance: Int32[np.ndarray, "M"] | None
    """Instance of the winning label, -1 for none; None where the source has no instances."""
    report: RegistrationReport
    """What was seen."""


@dataclass(frozen=True, slots=True)
class RegisteredFeatures:
    """An open-set feature for each of M Gaussians."""

    embedding: Float16[np.ndarray, "M D"]
    """Weighted mean of the masks' unit features, normalised; all zero where not valid (Dr. Splat)."""
    valid: Bool[np.ndarray, "M"]
    """Gaussians that have a feature."""
    report: RegistrationReport
    """What was seen."""


def register_labels(
    gaussians: Gaussians | PreparedGaussians,
    frames: Iterable[Frame],
    source: LabelSource,
    config: RegistrationConfig | None = None,
    *,
    threads: int = 1,
    progress: Callable[[int], object] | None = None,
) -> Registered:
    """Return the category of every Gaussian, by vote of the pixels it painted.

    A pixel votes for its label with weight confidence * alpha * T on each of its heaviest Gaussians. Where the source
    knows instances, each pair of category and instance is one label, so that the two never contradict.

    Args:
        gaussians: The scene.
        frames: Frames to look at, in order; only lens and pose are read here, photographs by the source.
        source: What names the pixels.
        config: Contributors, thresholds and the memory bound.
        threads: Frames registered side by side; the bits do not depend on it. The source is asked one frame at a time.
        progress: Called with the number of frames done.

    Raises:
        InputError: There is no frame, the source cannot read one, or it names a category outside its vocabulary.
    """
    config = config or RegistrationConfig()
    prepared = gaussians if isinstance(gaussians, PreparedGaussians) else prepare(gaussians)
    names = _LabelNumbers(len(source.vocabulary))

    def looked_at() -> Iterator[_Numbered]:
        for frame in frames:
            found = source.labels(frame)
            yield _Numbered(frame.camera, names.number(found.category, found.instance), found.confidence)

    sums, count = _spread(prepared, looked_at(), config, threads, progress)
    votes = sums.total()
    winner, confidence, total = votes.winners(
        len(prepared), source.silence if config.silence is None else config.silence
    )
    winner[(total < config.least_weight) | (confidence < config.least_confidence)] = UNLABELLED
    pairs = names.pairs()
    category, instance = (np.ascontiguousarray(pairs[winner + 1, column]) for column in (0, 1))
    report = _report(count, votes, sums, int((category != UNLABELLED).sum()), source.description)
    return Registered(source.vocabulary, category, confidence, instance if names.instances else None, report)


def register_features(
    gaussians: Gaussians | PreparedGaussians,
    frames: Iterable[Frame],
    source: FeatureSource,
    config: RegistrationConfig | None = None,
    *,
    threads: int = 1,
    progress: Callable[[int], object] | None = None,
) -> RegisteredFeatures:
    """Return a feature for every Gaussian: normalise(sum of w * normalise(feature of the mask)) over its pixels.

    Arguments are those of `register_labels`. Weights are summed per Gaussian and mask; features are only multiplied in
    at the end, a block of Gaussians at a time.

    Raises:
        InputError: There is no frame, the source cannot read one, or its features change size.
    """
    config = config or RegistrationConfig()
    prepared = gaussians if isinstance(gaussians, PreparedGaussians) else prepare(gaussians)
    rows: list[Float32[np.ndarray, "K D"]] = []

    def looked_at() -> Iterator[_Numbered]:
        first = 0
        for frame in frames:
            found = source.features(frame)
            if found.features.shape[1] != source.dimension:
                expected = f"{source.dimension}, as the source declares"
                raise InputError(frame.name, field="features", expected=expected, found=found.features.shape[1])
            norms = np.linalg.norm(found.features, axis=1)
            rows.append(found.features / np.where(norms > 0, norms, 1)[:, None])
            usable = np.append(norms > 0, False)  # -1 reads the last place
            yield _Numbered(frame.camera, np.where(usable[found.masks], found.masks + first, -1).astype(np.int32), None)
            first += len(norms)

    sums, count = _spread(prepared, looked_at(), config, threads, progress)
    votes = sums.total().without_silence()
    features = np.concatenate(rows)
    embedding = np.zeros((len(prepared), source.dimension), np.float16)
    weight = votes.weight_of_each(len(prepared))
    for start in range(0, len(prepared), ROWS_AT_ONCE):
        block = votes.matrix(start, min(start + ROWS_AT_ONCE, len(prepared)), len(features)) @ features
        norms = np.linalg.norm(block, axis=1)
        usable = (norms > 0) & (weight[start : start + ROWS_AT_ONCE] >= config.least_weight)
        block[usable] /= norms[usable, None]
        block[~usable] = 0.0
        embedding[start : start + ROWS_AT_ONCE] = block
    valid = (embedding != 0).any(axis=1)
    return RegisteredFeatures(
        embedding, valid, _report(count, sums.total(), sums, int(valid.sum()), source.description)
    )


class _Numbered(NamedTuple):
    """A frame whose pixels carry label numbers of the whole registration."""

    camera: Camera
    labels: Int32[np.ndarray, "H W"]
    confidence: Float32[np.ndarray, "H W"] | None


class _LabelNumbers:
    """Numbers pairs of category and instance as they are met."""

    def __init__(self, categories: int) -> None:
        self._categories = categories
        self._numbers: dict[tuple[int, int], int] = {}
        self.instances = False

    def number(
        self, category: Int32[np.ndarray, "H W"], instance: Int32[np.ndarray, "H W"] | None
    ) -> Int32[np.ndarray, "H W"]:
        if category.size and category.max() >= self._categories:
            expected = f"ids up to {self._categories - 1}, the vocabulary's last"
            raise InputError("labels", field="category", expected=expected, found=int(category.max()))
        self.instances |= instance is not None
        things = np.full_like(category, UNLABELLED) if instance is None else instance
        both = (category.astype(np.int64) << 32) + (things.astype(np.int64) + 1)
        found, place = np.unique(both, return_inverse=True)
        pairs = [(int(one >> 32), int(one & 0xFFFFFFFF) - 1) for one in found]
        numbers = [
            UNLABELLED if pair == (-1, -1) else self._numbers.setdefault(pair, len(self._numbers)) for pair in pairs
        ]
        return np.array(numbers, np.int32)[place].reshape(category.shape)

    def pairs(self) -> Int32[np.ndarray, "n 2"]:
        """Return category and instance of each number, after a row of -1 for no label."""
        return np.array([(UNLABELLED, UNLABELLED), *self._numbers], np.int32)


def _spread(
    prepared: PreparedGaussians,
    frames: Iterator[_Numbered],
    config: RegistrationConfig,
    threads: int,
    progress: Callable[[int], object] | None,
) -> tuple[VoteSums, int]:
    """Return the summed votes of all frames, added in their order, and the number of frames."""
    sums, done = VoteSums(config.memory_mb * (1 << 20) // PAIR_BYTES), 0
    waiting: list[Future[Votes]] = []

    def take() -> None:
        nonlocal done
        sums.add(waiting.pop(0).result())
        done += 1
        if progress is not None:
            progress(done)

    pool = ThreadPoolExecutor(threads, thread_name_prefix="register")
    try:
        for frame in frames:
            camera, labels, confidence = _thinned(frame, config.longest_side)
            waiting.append(
                pool.submit(frame_votes, prepared, camera, labels, confidence, config.contributors, config.first)
            )
            if len(waiting) > threads:
                take()
        while waiting:
            take()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    if not done:
        raise InputError("registration", field="frames", expected="at least one", found="none")
    return sums, done


def _thinned(frame: _Numbered, longest_side: int | None) -> _Numbered:
    """Return a frame of the labels' size, or of `longest_side` with the label nearest to each pixel's centre."""
    height, width = frame.labels.shape
    if longest_side is None or longest_side >= max(height, width):
        return frame._replace(camera=frame.camera.resized(width, height))
    share = longest_side / max(height, width)
    size = max(1, round(height * share)), max(1, round(width * share))
    rows, columns = (
        ((np.arange(to) + 0.5) * of / to).astype(int) for to, of in zip(size, (height, width), strict=True)
    )
    at = np.ix_(rows, columns)
    return _Numbered(
        frame.camera.resized(size[1], size[0]),
        np.ascontiguousarray(frame.labels[at]),
        None if frame.confidence is None else np.ascontiguousarray(frame.confidence[at]),
    )


def _report(frames: int, votes: Votes, sums: VoteSums, labelled: int, source: str) -> RegistrationReport:
    return RegistrationReport(
        frames=frames,
        seen=votes.gaussians_met(),
        labelled=labelled,
        pairs=len(votes),
        sums_mb=sums.most_pairs * PAIR_BYTES / (1 << 20),
        forgotten=sums.forgotten,
        source=source,
    )
