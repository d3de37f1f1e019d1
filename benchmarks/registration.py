"""Registration against ground truth: per-category IoU, memory and time on generated apartments and a ScanNet scan.

    python -m benchmarks.registration [--scene apartment|scannet] [--views 60] [--contributors 1 5 20 45]
    python -m benchmarks.registration --scene apartment --noise 0.2     # a fifth of all instances misnamed per view
    python -m benchmarks.registration --scene scannet --features 512    # a feature a mask in place of a label
    python -m benchmarks.registration --detector DIR [--image DIR]      # a real detector on a scene's rendered views

Truth is the category of every Gaussian. Label images are painted from it, the label that weighs most in each pixel, so
that what is lost is lost by registration: by mixing at edges, by surfaces no view shows. IoU counts Gaussians, those
without a label in the truth left out; a Gaussian that stays unlabelled counts against its category. No view shows the
inside of a cupboard, so IoU is given, too, over the visible Gaussians, those that dominate a pixel of some view: what
registration can know. With `--features` each instance in a view is a mask whose feature is that of its category, a
random direction, and noise as long; a Gaussian is right whose feature is nearest to that of its category. Times are CPU
seconds of the process for the registration alone; memory is the peak of the process (VmHWM) above what it held before.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.apartments import ROOT
from pipeline.construct import build_scannet_mesh
from pipeline.construct.semantics.labels_2d import FrameFeatures, FrameLabels
from pipeline.construct.semantics.labels_2d.scene_frames import rendered_frames
from pipeline.construct.semantics.labels_2d.ssd_mobilenet import SsdMobilenetConfig
from pipeline.construct.semantics.quantise import decode, encode, learn_codebooks
from pipeline.construct.semantics.register import Registered, RegistrationConfig, register_features, register_labels
from pipeline.render import color_image, label_image, prepare, render, visible_ids
from pipeline.scene import Scene
from pipeline.scene.captures import Frame
from pipeline.scene.load import load_scene
from pipeline.scene.procedural import build_apartment

DATA = Path(os.environ.get("SPLATREASONER_DATA", ROOT.parent / "shared" / "data"))
PALETTE = np.random.default_rng(7).integers(60, 256, (256, 3)).astype(np.uint8)


class PaintedLabels:
    """Label images painted from a scene's truth once and kept; `noise` is the share of instances misnamed in a view."""

    description, silence = "painted from the truth", 0.0

    def __init__(self, scene: Scene, frames: Sequence[Frame], noise: float, rng: np.random.Generator) -> None:
        assert scene.semantics.category is not None
        assert scene.semantics.instance is not None
        self.vocabulary = scene.semantics.vocabulary
        prepared, instance = prepare(scene.gaussians), scene.semantics.instance
        things = int(instance.max()) + 1
        category = np.full(things + 1, -1, np.int32)
        category[instance] = scene.semantics.category
        category[-1] = -1
        self._images = {}
        for frame in frames:
            ids = label_image(prepared, frame.camera, instance, things).labels
            named = category.copy()
            wrong = np.flatnonzero((rng.random(things) < noise) & (named[:-1] >= 0))
            named[wrong] = rng.integers(0, len(self.vocabulary), len(wrong))
            self._images[frame.name] = FrameLabels(named[ids], None, ids)

    def labels(self, frame: Frame) -> FrameLabels:
        """Return what was painted."""
        return self._images[frame.name]


class PaintedFeatures:
    """A feature for each instance in a view: its category's direction and noise of the same length."""

    description = "painted from the truth"

    def __init__(self, scene: Scene, labels: PaintedLabels, dimension: int, rng: np.random.Generator) -> None:
        self.dimension, self._labels, self._rng = dimension, labels, rng
        self.directions = self._random(len(scene.semantics.vocabulary))

    def _random(self, count: int) -> np.ndarray:
        drawn = self._rng.normal(size=(count, self.dimension)).astype(np.float32)
        return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)

    def features(self, frame: Frame) -> FrameFeatures:
        """Return what was painted, with new noise."""
        found = self._labels.labels(frame)
        assert found.instance is not None
        things, mask = np.unique(np.where(found.category >= 0, found.instance, -1), return_inverse=True)
        mask = mask.reshape(found.category.shape) - int(things[0] < 0)
        things = things[things >= 0]
        category = np.array([found.category[mask == row][0] for row in range(len(things))], np.int32)
        return FrameFeatures(mask.astype(np.int32), self.directions[category] + self._random(len(things)))


def peak_mb() -> float:
    status = Path("/proc/self/status").read_text()
    return int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1]) / 1024


def category_ious(truth: np.ndarray, found: np.ndarray) -> dict[int, float]:
    known = truth >= 0
    return {
        one: float(((found == one) & (truth == one)).sum() / (((found == one) & known) | (truth == one)).sum())
        for one in np.unique(truth[known]).tolist()
    }


def of_features(scene: Scene, frames: Sequence[Frame], labels: PaintedLabels, dimension: int, threads: int) -> None:
    truth = scene.semantics.category
    assert truth is not None
    source = PaintedFeatures(scene, labels, dimension, np.random.default_rng(1))
    prepared = prepare(scene.gaussians)
    register_features(prepared, frames[:1], source, threads=threads)
    before, start = peak_mb(), time.process_time()
    found = register_features(prepared, frames, source, threads=threads)
    spent, above = time.process_time() - start, peak_mb() - before
    print(
        f"{dimension} numbers a mask: CPU s/view {spent / len(frames):.3f}, pairs {found.report.pairs}, "
        f"sums {found.report.sums_mb:.0f} MiB, peak {above:.0f} MiB above before"
    )
    both = (truth >= 0) & found.valid

    def right(vectors: np.ndarray) -> float:
        return float(((vectors[both].astype(np.float32) @ source.directions.T).argmax(axis=1) == truth[both]).mean())

    books = learn_codebooks(found.embedding, dimension // 4, np.random.default_rng(0))
    codes = encode(found.embedding, books)
    print(
        f"nearest feature right: {right(found.embedding):.3f} in {2 * dimension} bytes, "
        f"{right(decode(codes, books)):.3f} in {codes.shape[1]}; labelled {both.sum() / (truth >= 0).sum():.3f}"
    )


def of_truth(scene: Scene, views: int, noise: float, contributors: Sequence[int], features: int, threads: int) -> None:
    truth, instance = scene.semantics.category, scene.semantics.instance
    assert truth is not None
    assert instance is not None
    chosen = [scene.views[i] for i in np.linspace(0, len(scene.views) - 1, views).astype(int)]
    frames = [Frame(view.name, view.camera) for view in chosen]
    source = PaintedLabels(scene, frames, noise, np.random.default_rng(0))
    prepared = prepare(scene.gaussians)
    size = f"{frames[0].camera.width}x{frames[0].camera.height}"
    print(f"{scene.name}: {len(truth)} Gaussians, {len(frames)} views of {size}, noise {noise:g}")
    if features:
        of_features(scene, frames, source, features, threads)
        return
    visible = np.zeros(len(truth), bool)
    for frame in frames:
        visible[visible_ids(prepared, frame.camera)] = True
    visible_truth = np.where(visible, truth, -1)
    print("k    mIoU   of visible   accuracy where labelled   labelled   CPU s/view   sums MiB   peak MiB above before")
    found = None
    known = truth >= 0
    for k in contributors:
        config = RegistrationConfig(contributors=k)
        register_labels(prepared, frames[:1], source, config, threads=threads)
        before, start = peak_mb(), time.process_time()
        found = register_labels(prepared, frames, source, config, threads=threads)
        spent, above = time.process_time() - start, peak_mb() - before
        ious = category_ious(truth, found.category)
        both = known & (found.category >= 0)
        right = float((found.category == truth)[both].mean())
        mean, of_visible = (
            np.mean(list(some.values())) for some in (ious, category_ious(visible_truth, found.category))
        )
        print(
            f"{k:<4} {mean:.3f}  {of_visible:.3f}        {right:.3f}{'':20} {both.sum() / known.sum():.3f}      "
            f"{spent / len(frames):.3f}        {found.report.sums_mb:6.1f}     {above:.0f}"
        )
    if found is not None:
        by_category(scene, truth, visible_truth, found)
        assert found.instance is not None
        both = known & (found.instance >= 0) & (instance >= 0)
        print(f"instance right where labelled: {(found.instance == instance)[both].mean():.3f}")


def by_category(scene: Scene, truth: np.ndarray, visible_truth: np.ndarray, found: Registered) -> None:
    ious, of_visible = category_ious(truth, found.category), category_ious(visible_truth, found.category)
    print("category: IoU, of visible (Gaussians), at the last k")
    for one, iou in sorted(ious.items(), key=lambda pair: -pair[1]):
        count, name = int((truth == one).sum()), scene.semantics.vocabulary[one]
        print(f"  {name}: {iou:.3f}, {of_visible.get(one, 0.0):.3f} ({count})")


def of_detector(folder: str, views: int, threads: int, image: Path | None) -> None:
    scene = load_scene(folder)
    chosen = [scene.views[i] for i in np.linspace(0, len(scene.views) - 1, min(views, len(scene.views))).astype(int)]
    source = SsdMobilenetConfig().open()
    start = time.process_time()
    prepared = prepare(scene.gaussians)
    found = register_labels(prepared, rendered_frames(prepared, chosen), source, threads=threads)
    spent = time.process_time() - start
    print(f"{scene.name}: {found.report}")
    print(f"CPU s/view {spent / len(chosen):.2f}, peak {peak_mb():.0f} MiB")
    ids, counts = np.unique(found.category, return_counts=True)
    for one, count in sorted(zip(ids.tolist(), counts.tolist(), strict=True), key=lambda pair: -pair[1]):
        print(f"  {found.vocabulary[one] if one >= 0 else '(none)'}: {count}")
    if image is not None:
        image.mkdir(parents=True, exist_ok=True)
        for view in chosen[:: max(1, len(chosen) // 24)]:
            rendering = render(prepared, view.camera, ("color",))
            labels = label_image(prepared, view.camera, found.category, len(found.vocabulary))
            shown = color_image(rendering)
            mask = (labels.labels >= 0) & (labels.weights > 0.5)
            shown[mask] = (0.4 * shown[mask] + 0.6 * PALETTE[labels.labels[mask]]).astype(np.uint8)
            Image.fromarray(shown).save(image / f"{view.name}.png")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=("apartment", "scannet"), default="apartment")
    parser.add_argument("--gaussians", type=int, default=80_000, help="of the apartment")
    parser.add_argument("--views", type=int, default=60)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--contributors", type=int, nargs="+", default=[1, 5, 20, 45])
    parser.add_argument("--features", type=int, default=0, help="numbers in a feature, a multiple of 4; 0 for labels")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--detector", default="", help="folder of a scene with views")
    parser.add_argument("--image", type=Path, help="folder for pictures of the detector's categories")
    options = parser.parse_args()
    if options.detector:
        of_detector(options.detector, options.views, options.threads, options.image)
        return
    if options.scene == "scannet":
        scene = build_scannet_mesh(DATA / "scannet_scene0000_00").scene
    else:
        scene = build_apartment(0, gaussians=options.gaussians).scene
    of_truth(scene, options.views, options.noise, options.contributors, options.features, options.threads)


if __name__ == "__main__":
    main()
