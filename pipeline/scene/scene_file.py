"""The scene folder: which file is what. `scene.json` says so; where it is silent, files are found by name."""

from __future__ import annotations

import json
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from pipeline.scene.formats.read import SUFFIXES
from pipeline.scene.text_embeddings import FILE as TEXTS
from schemas.errors import InputError
from schemas.storage import exists, join, list_files, name_of, read_bytes

SCENE = "scene.json"
SEMANTICS = "semantics.parquet"
OBJECTS = "objects.json"
QUESTIONS = "questions.jsonl"
BUILD = "build.json"
"""Where a scene that was built from a capture came from; nothing reads it but `check`."""
TRANSFORMS = "transforms.json"
COLMAP_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", "colmap")
METRES = ("metres", "meters", "m")


class SceneFile(BaseModel):
    """scene.json: names of the parts of a scene; every field may be left out."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(default="", description="Name unique in a run; the folder's name when empty.")
    up: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 1.0), description="Direction opposite to gravity in the scene's world, any length but 0."
    )
    units: str = Field(default="metres", description="Unit of the scene; the method's distances are metres.")
    gaussians: str = Field(default="", description="Splat file in the folder; found by name when empty.")
    cameras: str = Field(
        default="", description="transforms.json or the folder of a COLMAP model; found by name when empty."
    )

    @field_validator("up")
    @classmethod
    def _finite_direction(cls, up: tuple[float, float, float]) -> tuple[float, float, float]:
        length = sum(value * value for value in up)
        if not 0 < length < float("inf"):
            raise ValueError("a finite direction that is not zero")
        return up


@dataclass(frozen=True, slots=True)
class SceneParts:
    """URIs of what a scene folder holds; None for a part that is absent."""

    name: str
    """Scene name."""
    file: SceneFile
    """What scene.json says, or its defaults."""
    gaussians: str
    """Splat file."""
    cameras: str | None
    """transforms.json, or folder of a COLMAP model."""
    images: str | None
    """Folder of the photographs of a COLMAP model."""
    semantics: str | None
    """semantics.parquet."""
    texts: str | None
    """text_embeddings.npz."""
    objects: str | None
    """objects.json."""
    questions: str | None
    """questions.jsonl."""


def find_parts(uri: str) -> SceneParts:
    """Return where the parts of a scene lie.

    Raises:
        InputError: The folder is missing, scene.json is wrong, or there is no splat file or more than one.
        RetryError: A remote store failed to answer.
    """
    uri = str(uri)
    names = list_files(uri)
    if not names and not exists(uri):
        raise InputError(uri, expected="a scene folder", found="nothing there")
    if not names and exists(uri) and name_of(uri).lower().endswith(SUFFIXES):
        raise InputError(uri, expected="a scene folder (with a splat file and cameras)", found="a file")
    file = read_scene_file(join(uri, SCENE)) if SCENE in names else SceneFile()
    present = {name: join(uri, name) if name in names else None for name in (SEMANTICS, TEXTS, OBJECTS, QUESTIONS)}
    cameras = join(uri, file.cameras) if file.cameras else _find_cameras(uri, names)
    return SceneParts(
        name=file.name or name_of(uri),
        file=file,
        gaussians=join(uri, file.gaussians) if file.gaussians else _find_gaussians(uri, names),
        cameras=cameras,
        images=_find_images(uri) if cameras is not None and not cameras.endswith(".json") else None,
        semantics=present[SEMANTICS],
        texts=present[TEXTS],
        objects=present[OBJECTS],
        questions=present[QUESTIONS],
    )


def read_scene_file(uri: str) -> SceneFile:
    """Return a checked scene.json.

    Raises:
        InputError: It is no JSON, or a field is unknown or of another type.
    """
    try:
        return SceneFile.model_validate(json.loads(read_bytes(uri)))
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or "scene.json"
        raise InputError(uri, field=field, expected=first["msg"], found=str(first["input"])[:80]) from error
    except (ValueError, RecursionError) as error:
        raise InputError(uri, expected="JSON", found=error) from error


def _find_gaussians(uri: str, names: tuple[str, ...]) -> str:
    splats = [name for name in names if name.lower().endswith(SUFFIXES)]
    preferred = [name for name in splats if name.lower().split(".")[0] == "gaussians"]
    found = preferred or splats
    if not found and "meta.json" in names:
        found = ["meta.json"]
    if len(found) != 1:
        expected = f"one splat file ({', '.join(SUFFIXES)}), or its name in {SCENE}"
        raise InputError(uri, field="gaussians", expected=expected, found=", ".join(found) or "none")
    return join(uri, found[0])


def _find_cameras(uri: str, names: tuple[str, ...]) -> str | None:
    if TRANSFORMS in names:
        return join(uri, TRANSFORMS)
    if any(name in names for name in ("images.bin", "images.txt")):
        return uri
    for folder in COLMAP_FOLDERS:
        if any(exists(join(uri, folder, name)) for name in ("images.bin", "images.txt")):
            return join(uri, folder)
    return None


def _find_images(uri: str) -> str | None:
    return join(uri, "images") if exists(join(uri, "images")) else None
