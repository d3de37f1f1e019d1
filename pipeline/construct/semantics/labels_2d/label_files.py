"""Labels from images on disk: what annotators, renderers or another program's segmentation left behind."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Int32, Integer
from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.labels_2d.source import FrameLabels
from pipeline.scene.captures import Frame
from pipeline.scene.objects_file import read_objects
from pipeline.scene.semantics import UNLABELLED
from schemas import storage
from schemas.errors import InputError

WIDEST = "an image of one channel (8 or 16 bits, palettes by index) or an .npy array of integers"


class LabelFilesConfig(BaseModel):
    """Label and instance images, one a frame."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["label_files"] = "label_files"
    folder: str = Field(description="Folder or URI of the images; {scene} stands for the scene's name.")
    category: str = Field(
        default="{frame}.label.png", description="File of a frame's category ids in the folder; {frame} is its name."
    )
    instance: str = Field(
        default="", description="File of its instance ids, the same in every frame; empty where there are none."
    )
    names: str = Field(
        default="names.json",
        description="JSON file in the folder: a list of names by id, or an object from id to name.",
    )
    objects: str = Field(
        default="",
        description="objects.json in the folder: the ground-truth objects whose ids the instance images hold; copied "
        "into the scene. Empty where there is none.",
    )
    nothing: tuple[int, ...] = Field(default=(), description="Ids in the images that mean: no label.")

    def open(self, scene: str = "") -> LabelFiles:
        """Return the source; its names are read.

        Raises:
            InputError: The file of names, or that of objects, is missing or wrong.
        """
        return LabelFiles(self, scene)


class LabelFiles:
    """Reads a frame's labels from files.

    Ids index the names; where names are an object, ids it lacks are refused unless `nothing` lists them. Instances
    count as they are, `nothing` among them too.

    Args:
        config: Where the files lie.
        scene: Name of the scene.
    """

    silence = 0.0
    """What nobody annotated may be anything."""

    def __init__(self, config: LabelFilesConfig, scene: str = "") -> None:
        self._config, self._folder = config, config.folder.replace("{scene}", scene)
        uri = storage.join(self._folder, config.names)
        self._by_id = _read_names(uri)
        self.vocabulary = tuple(dict.fromkeys(self._by_id.values()))
        self.description = f"label images {config.category}"
        if config.objects and not config.instance:
            expected = "a pattern of instance images, where there are objects"
            raise InputError("label_files", field="instance", expected=expected, found="none")
        self.objects = read_objects(storage.join(self._folder, config.objects)) if config.objects else ()
        """Ground-truth objects, whose ids the instance images hold."""

    def labels(self, frame: Frame) -> FrameLabels:
        """Return the labels of a frame.

        Raises:
            InputError: A file is missing, is no image of ids, or holds an id without a name.
        """
        category = self._named(self._uri(self._config.category, frame))
        instance = None
        if self._config.instance:
            uri = self._uri(self._config.instance, frame)
            ids = read_ids(uri)
            if ids.shape != category.shape:
                raise InputError(uri, expected=f"the size {category.shape} of the categories", found=ids.shape)
            silent = np.isin(ids, self._config.nothing) | (ids < 0)
            instance = np.where(silent, UNLABELLED, ids.astype(np.int32)).astype(np.int32)
        return FrameLabels(category, None, instance)

    def _uri(self, pattern: str, frame: Frame) -> str:
        return storage.join(self._folder, pattern.replace("{frame}", frame.name))

    def _named(self, uri: str) -> Int32[np.ndarray, "H W"]:
        ids = read_ids(uri)
        found, place = np.unique(ids, return_inverse=True)
        numbers = []
        for one in found.tolist():
            if one in self._config.nothing or one < 0:
                numbers.append(UNLABELLED)
            elif one in self._by_id:
                numbers.append(self.vocabulary.index(self._by_id[one]))
            else:
                raise InputError(uri, field=f"id {one}", expected=f"a name in {self._config.names}", found="none")
        return np.array(numbers, np.int32)[place].reshape(ids.shape)


def read_ids(uri: str) -> Integer[np.ndarray, "H W"]:
    """Return the integers of an image of one channel, or of an .npy array.

    Raises:
        InputError: The file is missing, or is neither.
    """
    from PIL import Image, UnidentifiedImageError

    data = storage.read_bytes(uri)
    try:
        if uri.endswith(".npy"):
            ids = np.load(io.BytesIO(data), allow_pickle=False)
        else:
            with Image.open(io.BytesIO(data)) as image:
                ids = np.asarray(image)
    except (OSError, ValueError, EOFError, UnidentifiedImageError) as error:
        raise InputError(uri, expected=WIDEST, found=str(error)) from error
    if ids.ndim != 2 or ids.dtype.kind not in "iu" or not ids.size:
        raise InputError(uri, expected=WIDEST, found=f"{ids.dtype} {ids.shape}")
    if int(ids.max()) > np.iinfo(np.int32).max:
        raise InputError(uri, expected="ids under 2^31", found=int(ids.max()))
    return ids


def _read_names(uri: str) -> dict[int, str]:
    expected = "a JSON list of names by id, or an object from id to name"
    try:
        loaded = json.loads(storage.read_bytes(uri))
        if not isinstance(loaded, dict | list):
            raise InputError(uri, expected=expected, found=type(loaded).__name__)
        names = {int(key): name for key, name in (loaded.items() if isinstance(loaded, dict) else enumerate(loaded))}
    except ValueError as error:
        raise InputError(uri, expected=expected, found=str(error)) from error
    if not names or not all(isinstance(name, str) and name for name in names.values()):
        raise InputError(uri, expected=expected, found="an empty name, none, or no text")
    return names


def write_names(vocabulary: tuple[str, ...], folder: Path, file: str = "names.json") -> None:
    """Write the names that `LabelFiles` reads."""
    storage.write_bytes_atomic(str(folder / file), json.dumps(list(vocabulary), indent=1).encode())
