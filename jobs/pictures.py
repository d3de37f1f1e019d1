"""Rendered views as files: PNG to look at, NPZ with the exact arrays, and a contact sheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Shaped, UInt8

from schemas.errors import InputError
from schemas.run_folder import safe_name

if TYPE_CHECKING:
    from pipeline.render import Rendering
    from pipeline.scene.scene import Scene

OUTPUTS = ("color", "depth", "alpha", "dominant", "category")
SHEET_COLUMNS = 6
SHEET_WIDTH = 240
"""Pixels a picture on a contact sheet."""


def render_views(
    scene_uri: str,
    output: Path,
    names: Sequence[str],
    outputs: Sequence[str],
    *,
    every: int = 1,
    sheet: bool = False,
    threads: int = 1,
) -> list[Path]:
    """Render recorded views into a folder; return the files written.

    Args:
        scene_uri: Scene folder.
        output: Where the files go; made where it is missing.
        names: Views; none takes all.
        outputs: Some of OUTPUTS.
        every: Of all views, every n-th; with names, all named ones.
        sheet: Also write `sheet.png` with the colours of all.
        threads: Threads a picture.

    Raises:
        InputError: The scene is wrong, or a view or an output is unknown.
    """
    from pipeline.render import category_image, prepare, render
    from pipeline.scene.load import load_scene

    for kind in outputs:
        if kind not in OUTPUTS:
            raise InputError("--outputs", expected=f"some of {', '.join(OUTPUTS)}", found=kind)
    scene = load_scene(scene_uri)
    views = {view.name: view for view in scene.views}
    for name in names:
        if name not in views:
            raise InputError(scene_uri, field="camera", expected=f"one of {_few(list(views))}", found=name)
    chosen = [views[name] for name in names] if names else list(scene.views)[::every]
    prepared = prepare(scene.gaussians)
    wanted = {"dominant" if kind == "category" else kind for kind in outputs} | ({"color"} if sheet else set())
    written, colors = [], []
    for view in chosen:
        picture = render(prepared, view.camera, tuple(sorted(wanted)), threads=threads)
        arrays: dict[str, Any] = {
            kind: getattr(picture, kind) for kind in ("color", "depth", "alpha", "dominant", "dominant_weight")
        }
        if "category" in outputs:
            if scene.semantics.category is None:
                raise InputError(scene_uri, field="semantics", expected="a category per Gaussian", found="none")
            arrays["category"] = category_image(arrays["dominant"], scene.semantics.category)
        stem = safe_name(view.name)
        kept = {kind: array for kind, array in arrays.items() if array is not None}
        for kind in outputs:
            written.append(save_picture(_shown(kind, picture, kept, scene), output / f"{stem}.{kind}.png"))
        if set(outputs) != {"color"}:
            path = output / f"{stem}.npz"
            np.savez_compressed(path, **kept)
            written.append(path)
        if sheet:
            colors.append(_shown("color", picture, kept, scene))
    if colors:
        written.append(save_picture(contact_sheet(colors), output / "sheet.png"))
    return written


def contact_sheet(pictures: Sequence[UInt8[np.ndarray, "H W 3"]]) -> UInt8[np.ndarray, "SH SW 3"]:
    """Return the pictures, made small, in rows of SHEET_COLUMNS."""
    from PIL import Image

    small = []
    for picture in pictures:
        image = Image.fromarray(picture)
        image.thumbnail((SHEET_WIDTH, SHEET_WIDTH))
        small.append(image)
    width, height = max(i.width for i in small), max(i.height for i in small)
    columns = min(SHEET_COLUMNS, len(small))
    whole = Image.new("RGB", (columns * width, -(-len(small) // columns) * height))
    for number, image in enumerate(small):
        whole.paste(image, (number % columns * width, number // columns * height))
    return np.asarray(whole)


def _shown(kind: str, picture: Rendering, arrays: dict[str, Any], scene: Scene) -> UInt8[np.ndarray, "H W 3"]:
    """Return an output as something to look at."""
    if kind == "color":
        from pipeline.render import color_image

        return color_image(picture)
    array = arrays[kind]
    if kind == "alpha":
        return _gray(array)
    if kind == "depth":
        near, far = np.percentile(array[array > 0], (1, 99)) if (array > 0).any() else (0.0, 1.0)
        return np.where((array > 0)[..., None], _gray(1 - 0.9 * (array - near) / max(far - near, 1e-6)), 0).astype(
            np.uint8
        )
    return _paletted(array)


def _gray(array: Shaped[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W 3"]:
    return np.repeat((np.clip(array, 0, 1) * 255).round().astype(np.uint8)[..., None], 3, axis=2)


def _paletted(ids: Shaped[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W 3"]:
    """Give every id a colour of its own; -1 is black."""
    mixed = (ids.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    parts = [(mixed >> np.uint64(shift)).astype(np.uint8) // 2 + 96 for shift in (56, 40, 24)]
    return np.where((ids >= 0)[..., None], np.stack(parts, axis=-1), 0).astype(np.uint8)


def save_picture(picture: UInt8[np.ndarray, "H W 3"], path: Path) -> Path:
    """Write a picture, making its folder where it is missing; return the path."""
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture).save(path)
    return path


def _few(names: list[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
