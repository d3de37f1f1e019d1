"""A capture becomes a scene folder: frames chosen, start, photographs placed, optimisation, measures, semantics, files.

scene.json is written last: a folder that has one is whole.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from pipeline.construct.build_config import BuildConfig
from pipeline.construct.fusion.fuse import fuse
from pipeline.construct.fusion.sparse_start import start_from_points
from pipeline.construct.held_out import split_held_out
from pipeline.construct.photos.build_photos import place_photos, try_photos
from pipeline.construct.semantics.describe import Described, describe
from pipeline.construct.training.train_config import TrainConfig
from pipeline.construct.training.train_progress import TrainProgress, held_out_quality
from pipeline.construct.upright import estimate_up
from pipeline.geometry import Camera
from pipeline.scene import Gaussians, Scene, Semantics
from pipeline.scene.captures import Capture, CaptureKind, Frame, open_capture, select_frames
from pipeline.scene.captures.select_frames import CANDIDATES
from pipeline.scene.save import save_scene
from pipeline.scene.scene_file import BUILD, QUESTIONS
from schemas import storage
from schemas.builds import BuildRow
from schemas.errors import InputError, StoppedError
from schemas.question_file import save_questions
from schemas.questions import Question

CHECKPOINT = "checkpoint"
"""File of the optimisation's checkpoint, in its folder."""


@dataclass(frozen=True, slots=True)
class BuildProgress:
    """How far the build of one capture is."""

    stage: str
    """open, select, fuse, photos, train, measure, describe or save."""
    share: float
    """Of this stage, 0 to 1."""
    detail: str = ""
    """What else is known, such as the quality reached."""


@dataclass(frozen=True, slots=True)
class BuildRecord:
    """A scene that was built."""

    row: BuildRow
    """What it is made of and how good it is."""
    seconds: dict[str, float]
    """Wall time by stage; of this session alone where an earlier one was cut off."""


@dataclass(slots=True)
class _Told:
    """Tells how far it is, keeps the time of each stage, and ends the work when asked to."""

    progress: Callable[[BuildProgress], object]
    stop: Callable[[], bool]
    stage: str = ""
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def at(self, stage: str) -> Iterator[None]:
        self.stage, start = stage, time.perf_counter()
        self.share(0.0)
        yield
        self.seconds[stage] = time.perf_counter() - start

    def share(self, share: float, detail: str = "") -> None:
        if self.stop():
            raise StoppedError(f"stopped in stage {self.stage}")
        self.progress(BuildProgress(self.stage, share, detail))

    def count(self, total: int) -> Callable[[int], None]:
        return lambda done: self.share(min(1.0, done / max(1, total)))


def build_capture(
    capture: str,
    config: BuildConfig,
    output: str,
    *,
    kind: CaptureKind = "auto",
    name: str = "",
    questions: Sequence[Question] = (),
    checkpoint: Path | None = None,
    threads: int = 1,
    progress: Callable[[BuildProgress], object] = lambda progress: None,
    stop: Callable[[], bool] = lambda: False,
) -> BuildRecord:
    """Build a scene folder from a capture and return what came of it.

    Without a time budget the same capture and config give the same Gaussians, whatever the thread count and however
    often the work was cut off.

    Args:
        capture: What `open_capture` takes.
        config: All that shapes the scene.
        output: Folder or URI of the scene; scene.json is written last, so a folder that has one is whole.
        kind: Format of the capture.
        name: Name of the scene; empty takes the capture's.
        questions: Questions to copy into the folder, those of this scene; a capture has none of its own.
        checkpoint: Local folder for what the optimisation has so far, from which it goes on; None keeps nothing.
        threads: Threads of every stage.
        progress: Told how far it is, often.
        stop: Looked at often; once true the work ends with what it has kept.

    Raises:
        InputError: The capture is wrong, or has neither depth nor sparse points.
        StoppedError: `stop` said so.
    """
    told = _Told(progress, stop)
    with told.at("open"):
        whole = open_capture(capture, kind, name=name)
    with told.at("select"):
        fitted, held_out = split_held_out(whole, config.hold_out, config.most_held_out)
        if config.frames is not None:
            looked_at = told.count(min(len(fitted), CANDIDATES * config.frames))
            fitted = select_frames(fitted, config.frames, progress=looked_at)
    warnings = [*fitted.warnings]
    with told.at("fuse"):
        began, source, skipped = _start(fitted, config, threads, told)
    photos_moved = 0
    if source == "depth" and config.register_photos != "off":
        with told.at("photos"):
            fitted, began, photos_moved = _place_photos(fitted, began, config, threads, told, warnings)
    gaussians, reached, quality = began, None, None
    if skipped:
        warnings.append(f"no depth in {skipped} frames that were fitted to")
    if config.train.steps:
        with told.at("train"):
            settings = _train_settings(config, source, threads)
            gaussians, reached, fitted = _trained(began, fitted, held_out, settings, checkpoint, told)
            quality = reached.held_out
    if held_out and quality is None:
        with told.at("measure"):
            quality = held_out_quality(gaussians, held_out, aligned=True, threads=threads, progress=told.share)
    with told.at("describe"):
        described = _described(gaussians, fitted, config, threads, told, warnings)
    meaning = described.semantics
    up = whole.up
    if up is None:
        up = estimate_up(whole.cameras)
        warnings.append(f"the capture does not say which way is up: {_shown(up)}, as the cameras are held")
    # In the order they were taken, those fitted to where they were fitted.
    placed = {frame.name: frame for frame in (*held_out, *fitted.frames)}
    recorded = replace(whole, frames=tuple(placed[frame.name] for frame in whole.frames if frame.name in placed))
    scene = Scene(whole.name, gaussians, recorded.views, meaning, up, described.texts)
    row = BuildRow(
        scene=scene.name,
        capture=str(capture),
        scene_uri=str(output),
        status="built",
        reason="",
        start=source,
        frames=len(whole),
        fitted=len(fitted),
        held_out=len(held_out),
        skipped=len(fitted.skipped) + skipped,
        started=len(began),
        gaussians=len(gaussians),
        steps=reached.step if reached is not None else 0,
        psnr=None if quality is None else quality.psnr,
        ssim=None if quality is None else quality.ssim,
        depth_error_m=None if quality is None else quality.depth_abs_m,
        depth_within_5cm=None if quality is None else quality.depth_within_5cm,
        labels="" if config.semantics.source is None else config.semantics.source.kind,
        categories=len(meaning.present()),
        labelled=meaning.labelled_share,
        questions=len(questions),
        warnings=tuple(warnings),
        photos_moved=photos_moved,
        aligned_psnr=None if quality is None else quality.aligned_psnr,
        aligned_ssim=None if quality is None else quality.aligned_ssim,
        exposed_psnr=None if quality is None else quality.exposed_psnr,
        objects=len(described.objects),
    )
    with told.at("save"):
        if questions:
            save_questions(questions, storage.join(output, QUESTIONS))
        storage.write_bytes_atomic(storage.join(output, BUILD), _provenance(row, config))
        save_scene(scene, output, described.objects)
    return BuildRecord(row, told.seconds)


def _start(capture: Capture, config: BuildConfig, threads: int, told: _Told) -> tuple[Gaussians, str, int]:
    """Return the Gaussians a scene begins as, what from, and how many frames had no depth to give."""
    depth = any(frame.depth is not None for frame in capture.frames)
    if config.start == "depth" and not depth:
        raise InputError(
            f"capture {capture.name}", field="start", expected="depth images, or start: points", found="none"
        )
    if depth and config.start != "points":
        fusion = config.fusion.model_copy(update={"threads": threads})
        fused = fuse(capture.frames, fusion, progress=told.share)
        return fused.gaussians, "depth", len(fused.report.skipped)
    if capture.points is None:
        expected = "sparse points" if config.start == "points" else "depth images or sparse points"
        raise InputError(f"capture {capture.name}", field="start", expected=expected, found="none")
    return start_from_points(capture.points.read(), capture.cameras), "points", 0


def _place_photos(
    capture: Capture, fused: Gaussians, config: BuildConfig, threads: int, told: _Told, warnings: list[str]
) -> tuple[Capture, Gaussians, int]:
    """Return the capture with its photographs moved, the scene of that, and how many were; as given where none pays.

    What was done is added to the warnings.
    """
    fusion, tried = config.fusion.model_copy(update={"threads": threads}), ""
    if config.register_photos == "auto":
        trial = try_photos(capture.frames, fusion, progress=lambda share: told.share(share, "a trial on some frames"))
        if trial is None or not trial.pays:
            return capture, fused, 0
        tried = f": {len(trial.falls)} photographs that were left out of a trial fit {trial.gain:.1%} better"
    moved, count = place_photos(capture, fused, threads=threads, progress=told.count(len(capture)))
    warnings.append(
        f"moved {count} of {len(capture)} photographs to where the scene says they were taken, and the recorded views "
        f"with them{tried}"
    )
    return moved, fuse(moved.frames, fusion, progress=told.share).gaussians, count


def _train_settings(config: BuildConfig, source: str, threads: int) -> TrainConfig:
    """Return the settings of the optimisation for what the Gaussians began as."""
    train = config.train.model_copy(update={"threads": threads})
    if source == "points" and not train.density.every:
        density = train.density.model_copy(update={"every": config.densify_points_every})
        train = train.model_copy(update={"density": density})
    return train


def _trained(
    start: Gaussians,
    capture: Capture,
    held_out: Sequence[Frame],
    config: TrainConfig,
    checkpoint: Path | None,
    told: _Told,
) -> tuple[Gaussians, TrainProgress, Capture]:
    """Return the optimised Gaussians, the last report, and the capture with the poses that were fitted."""
    # Torch takes a second to import, and a scene without steps has no need of it.
    from pipeline.construct.training.train import train

    shown = [frame for frame in capture.frames if frame.image is not None]
    trained = train(
        start,
        shown,
        config,
        checkpoint=None if checkpoint is None else checkpoint / CHECKPOINT,
        progress=lambda report: told.share(report.share, _told_quality(report)),
        stop=told.stop,
        # Measured afterwards, where a stop need not wait, unless someone wants to see it on the way.
        held_out=held_out if config.evaluate_steps else (),
    )
    if config.refine_poses:
        cameras = {frame.name: camera for frame, camera in zip(shown, trained.cameras, strict=True)}
        capture = replace(capture, frames=tuple(_at(frame, cameras.get(frame.name)) for frame in capture.frames))
    return trained.gaussians, trained.history[-1], capture


def _at(frame: Frame, camera: Camera | None) -> Frame:
    """Return a frame whose photograph was taken elsewhere than was recorded; depth keeps its lens."""
    return frame if camera is None else replace(frame, camera=camera, depth_camera=frame.depth_lens)


def _described(
    gaussians: Gaussians, capture: Capture, config: BuildConfig, threads: int, told: _Told, warnings: list[str]
) -> Described:
    """Return what the frames' photographs say of the Gaussians, and add to the warnings what one should know of it."""
    if config.semantics.source is None:
        warnings.append("no categories: no source of semantics was named, so no question finds anything")
        return Described(Semantics(()), None, None, None, ())
    frames = [frame for frame in capture.frames if frame.image is not None]
    looked = told.count(len(frames))
    found = describe(gaussians, frames, config.semantics, scene=capture.name, threads=threads, progress=looked)
    warnings.extend(found.warnings)
    return found


def _told_quality(report: TrainProgress) -> str:
    told = [f"step {report.step} of {report.steps}", f"{report.gaussians:,} Gaussians"]
    if report.psnr is not None:
        told.append(f"PSNR {report.psnr:.2f} dB")
    if report.held_out is not None:
        told.append(f"held out {report.held_out.psnr:.2f} dB")
    return ", ".join(told)


def _provenance(row: BuildRow, config: BuildConfig) -> bytes:
    """Return build.json: where a scene came from, for whoever finds its folder."""
    content: dict[str, Any] = {**asdict(row), "config": config.model_dump(mode="json")}
    return json.dumps(content, indent=1, ensure_ascii=False).encode()


def _shown(direction: Any) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in direction) + ")"
