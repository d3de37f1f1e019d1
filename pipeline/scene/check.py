"""What is in a scene, what is missing and what is wrong: a report, never an exception for a bad scene."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from pipeline.scene.captures import ViewsFile
from pipeline.scene.formats import GaussiansFile, read_gaussians
from pipeline.scene.gaussians import Gaussians
from pipeline.scene.load import load_objects, load_semantics, read_views, unit_notes
from pipeline.scene.objects import SceneObject
from pipeline.scene.scene_file import BUILD, METRES, OBJECTS, SceneParts, find_parts
from pipeline.scene.semantics import UNLABELLED, Semantics
from pipeline.scene.views import View
from schemas.errors import InputError
from schemas.storage import exists, join, name_of, read_bytes

T = TypeVar("T")

PERCENTILES = (1, 50, 99)

BODY_M = (1.0, 300.0)
"""Sizes of a scene in metres that raise no doubt about its unit: a cupboard to a large building."""

MIN_UP_AGREEMENT = 0.3
"""Mean cosine between the cameras' up and the scene's: people tilt cameras, they do not carry them sideways."""

FAR_OUTSIDE = 1.0
"""A camera farther outside the bounds than this many times their diagonal is most likely in other coordinates."""


@dataclass(frozen=True, slots=True)
class SceneReport:
    """Findings about one scene folder."""

    uri: str
    """Folder that was checked."""
    name: str = ""
    """Scene name."""
    format: str = ""
    """Format of the splat file; empty when it could not be read."""
    gaussians: int = 0
    """Usable Gaussians."""
    dropped: dict[str, int] = field(default_factory=dict)
    """Unusable Gaussians by reason."""
    sh_degree: int = 0
    """Degree of the spherical harmonics."""
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    """Corners that hold the middle 98 % of the centres on each axis; outliers stretch the rest."""
    units: str = ""
    """Declared unit."""
    opacity: tuple[float, ...] = ()
    """Percentiles 1, 50 and 99 of the opacity, 0 to 1."""
    scale: tuple[float, ...] = ()
    """Percentiles 1, 50 and 99 of the largest standard deviation."""
    views: int = 0
    """Usable views."""
    skipped_views: int = 0
    """Views with an unusable pose."""
    photographs: int = 0
    """Views whose image file is there."""
    image_sizes: tuple[tuple[int, int], ...] = ()
    """Distinct (width, height) of the views."""
    categories: int = 0
    """Categories at least one Gaussian carries."""
    labelled: float = 0.0
    """Share of Gaussians with a category, 0 to 1."""
    embedding_size: int = 0
    """D; 0 without embeddings."""
    instances: int = 0
    """Ground-truth instances."""
    objects: int = 0
    """Objects in objects.json."""
    origin: str = ""
    """What the scene was built from and how well; empty where its folder does not say."""
    missing: tuple[str, ...] = ()
    """Parts that are absent and what that costs."""
    warnings: tuple[str, ...] = ()
    """What looks wrong but can be used."""
    errors: tuple[str, ...] = ()
    """What makes the scene unusable."""

    @property
    def usable(self) -> bool:
        """Whether the scene can be loaded and rendered; `missing` says which work needs more."""
        return not self.errors

    def lines(self) -> tuple[str, ...]:
        """Return the report as lines of text."""
        out = [f"scene {self.name}: {'usable' if self.usable else 'NOT USABLE'} ({self.uri})"]
        if self.origin:
            out.append(f"built from: {self.origin}")
        if self.format:
            out.append(f"gaussians: {self.gaussians:,} ({self.format}, SH degree {self.sh_degree})")
            out += [f"dropped: {count:,}: {reason}" for reason, count in self.dropped.items()]
        if self.bounds is not None:
            low, high = self.bounds
            size = " x ".join(f"{b - a:.2f}" for a, b in zip(low, high, strict=True))
            corners = " to ".join("(" + ", ".join(f"{value:.2f}" for value in corner) + ")" for corner in self.bounds)
            out.append(f"bounds (98 % of centres): {corners}, {size} {self.units}")
            out.append("opacity p1, p50, p99: " + ", ".join(f"{value:.3f}" for value in self.opacity))
            out.append(f"largest scale p1, p50, p99 ({self.units}): " + ", ".join(f"{v:.4g}" for v in self.scale))
        if self.views or self.skipped_views:
            sizes = ", ".join(f"{width}x{height}" for width, height in self.image_sizes[:4])
            out.append(
                f"views: {self.views} ({sizes}), {self.skipped_views} skipped, {self.photographs} with a photograph"
            )
        if self.categories or self.embedding_size or self.instances:
            out.append(
                f"semantics: {self.categories} categories, {self.labelled:.0%} of Gaussians labelled, "
                f"embedding size {self.embedding_size}, {self.instances} instances"
            )
        if self.objects:
            out.append(f"objects: {self.objects}")
        out += [f"missing: {line}" for line in self.missing]
        out += [f"warning: {line}" for line in self.warnings]
        out += [f"error: {line}" for line in self.errors]
        return tuple(out)


def check_scene(uri: str) -> SceneReport:
    """Return what is in a scene folder, what is missing and what is wrong; every part is tried.

    Raises:
        RetryError: A remote store failed to answer.
    """
    uri = str(uri)
    errors: list[str] = []
    parts = _tried(errors, lambda: find_parts(uri))
    if parts is None:
        return SceneReport(uri, name=name_of(uri), errors=tuple(errors))
    splats = _tried(errors, lambda: read_gaussians(parts.gaussians))
    views = _tried(errors, lambda: read_views(parts))
    kept = splats.kept if splats is not None else None
    meaning = _tried(errors, lambda: load_semantics(parts.semantics, kept)) if kept is not None else None
    objects = _tried(errors, lambda: load_objects(uri)) or ()
    semantics = meaning[0] if meaning is not None else Semantics(())
    mended = meaning[1] if meaning is not None and parts.semantics is not None else ()
    warnings = [*(splats.warnings if splats else ()), *(views.warnings if views else ()), *mended, *unit_notes(parts)]
    if splats is not None:
        warnings += _size_warnings(splats.gaussians, parts)
        if views is not None:
            warnings += _view_warnings(splats.gaussians, views.views, np.array(parts.file.up))
    warnings += _object_warnings(objects, semantics)
    origin = _tried(warnings, lambda: _origin(uri)) or ""
    return _report(uri, parts, splats, views, semantics, objects, origin, tuple(warnings), tuple(errors))


def _report(
    uri: str,
    parts: SceneParts,
    splats: GaussiansFile | None,
    views: ViewsFile | None,
    semantics: Semantics,
    objects: tuple[SceneObject, ...],
    origin: str,
    warnings: tuple[str, ...],
    errors: tuple[str, ...],
) -> SceneReport:
    gaussians = splats.gaussians if splats is not None else None
    found = views.views if views is not None else ()
    category, instance = semantics.category, semantics.instance
    return SceneReport(
        uri=uri,
        name=parts.name,
        format=splats.format if splats is not None else "",
        gaussians=len(gaussians) if gaussians is not None else 0,
        dropped=splats.dropped if splats is not None else {},
        sh_degree=gaussians.sh_degree if gaussians is not None else 0,
        bounds=_bounds(gaussians) if gaussians is not None else None,
        units="m" if parts.file.units.lower() in METRES else parts.file.units,
        opacity=_percentiles(_opacities(gaussians)) if gaussians is not None else (),
        scale=_percentiles(np.exp(gaussians.log_scales.max(axis=1))) if gaussians is not None else (),
        views=len(found),
        skipped_views=len(views.skipped) if views is not None else 0,
        photographs=sum(view.image is not None for view in found),
        image_sizes=tuple(sorted({(view.camera.width, view.camera.height) for view in found})),
        categories=len(semantics.present()),
        labelled=float((category != UNLABELLED).mean()) if category is not None and len(category) else 0.0,
        embedding_size=semantics.embedding.shape[1] if semantics.embedding is not None else 0,
        instances=len(np.unique(instance[instance >= 0])) if instance is not None else 0,
        objects=len(objects),
        origin=origin,
        missing=_missing(parts, found, semantics),
        warnings=warnings,
        errors=errors,
    )


def _tried(errors: list[str], part: Callable[[], T]) -> T | None:
    """Return what a part gives; None, with a line in `errors`, where its input is wrong."""
    try:
        return part()
    except InputError as error:
        errors.append(str(error))
        return None


def _origin(uri: str) -> str:
    """Return what a scene was built from, in words; empty where its folder does not say.

    Raises:
        InputError: build.json is damaged.
    """
    place = join(uri, BUILD)
    if not exists(place):
        return ""
    try:
        found = json.loads(read_bytes(place))
        told = f"{found['capture']}, {found['fitted']} frames fitted, {found['steps']} steps"
        if found["psnr"] is not None:
            told += f"; {found['held_out']} frames held out: PSNR {found['psnr']:.2f} dB, SSIM {found['ssim']:.3f}"
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(place, expected="what a build wrote", found=f"{type(error).__name__}: {error}") from error
    return told


def _opacities(gaussians: Gaussians) -> Float[np.ndarray, "M"]:
    # exp of a large negative logit overflows to infinity, and 1 / infinity is the right answer, 0.
    with np.errstate(over="ignore"):
        return 1 / (1 + np.exp(-gaussians.opacity_logits))


def _percentiles(values: Float[np.ndarray, "M"]) -> tuple[float, ...]:
    return tuple(float(value) for value in np.percentile(values, PERCENTILES))


def _bounds(gaussians: Gaussians) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    low, high = np.percentile(gaussians.means.astype(np.float64), (PERCENTILES[0], PERCENTILES[-1]), axis=0).tolist()
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def _size_warnings(gaussians: Gaussians, parts: SceneParts) -> list[str]:
    low, high = (np.array(corner) for corner in _bounds(gaussians))
    size = float((high - low).max())
    if parts.file.units.lower() not in METRES or BODY_M[0] <= size <= BODY_M[1]:
        return []
    return [f"the scene is {size:.3g} m across: are its units really metres?"]


def _view_warnings(gaussians: Gaussians, views: tuple[View, ...], up: Float[np.ndarray, "3"]) -> list[str]:
    lines = []
    ups = -np.stack([view.camera.world_to_camera[1, :3] for view in views])
    agreement = float((ups @ (up / np.linalg.norm(up))).mean())
    if agreement < MIN_UP_AGREEMENT:
        direction = ", ".join(f"{value:.2f}" for value in ups.mean(axis=0))
        lines.append(f"cameras disagree with the scene's up {up.tolist()}: theirs is about ({direction})")
    low, high = (np.array(corner) for corner in _bounds(gaussians))
    centers = np.stack([view.camera.center for view in views])
    gap = np.maximum(0, np.maximum(low - centers, centers - high)).max(axis=1)
    if outside := int((gap > FAR_OUTSIDE * np.linalg.norm(high - low)).sum()):
        lines.append(f"{outside} of {len(views)} cameras are far outside the Gaussians: other coordinates?")
    return lines


def _object_warnings(objects: tuple[SceneObject, ...], semantics: Semantics) -> list[str]:
    if not objects or semantics.instance is None:
        return []
    stray = sorted({item.instance for item in objects} - set(np.unique(semantics.instance).tolist()))
    return [f"{len(stray)} objects have no Gaussian of their instance, such as {stray[0]}"] if stray else []


def _missing(parts: SceneParts, views: tuple[View, ...], semantics: Semantics) -> tuple[str, ...]:
    lines = []
    if parts.semantics is None:
        lines.append("semantics.parquet: no category can be activated, so no question can be answered")
    elif semantics.instance is None:
        lines.append("instance ids: grounding cannot be scored")
    if views and not any(view.image for view in views):
        lines.append("photographs: initial views are shown as renders")
    if parts.objects is None:
        lines.append(f"{OBJECTS}: no questions can be generated from ground truth")
    if parts.questions is None:
        lines.append("questions.jsonl: give a question file when submitting")
    return tuple(lines)
