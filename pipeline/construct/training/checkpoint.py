"""Training on disk: one file a run, replaced whole, so that a run killed at any moment goes on from its last one."""

from __future__ import annotations

import json
import os
import uuid
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schemas.errors import InputError

FORMAT = 1
"""Changes when what a checkpoint holds does."""
_HEAD = "head"


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Everything the next step depends on."""

    run: str
    """Digest of the start, the frames and the settings: another run's file is not taken up."""
    head: Mapping[str, Any]
    """Numbers and texts: the step, seconds so far, the history."""
    arrays: Mapping[str, np.ndarray]
    """Parameters, moments and sums."""


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write the file beside its place, flush it to the disk and rename it; a reader sees the old one or the new.

    Raises:
        InputError: The place may not be written.
    """
    head = json.dumps({"format": FORMAT, "run": checkpoint.run, **checkpoint.head}).encode()
    # A name of its own: a worker that outlives its driver may write at the same time as the one that goes on.
    aside = path.with_name(f"{path.name}.{uuid.uuid4().hex}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with aside.open("wb") as file:
            np.savez(file, allow_pickle=False, **{_HEAD: np.frombuffer(head, np.uint8), **checkpoint.arrays})
            file.flush()
            os.fsync(file.fileno())
        os.replace(aside, path)
    except OSError as error:
        with suppress(OSError):
            aside.unlink()
        raise InputError(path, expected="a place for checkpoints that can be written", found=error) from error


def load_checkpoint(path: Path, run: str) -> Checkpoint | None:
    """Return what was saved, or None where nothing was.

    Args:
        path: The file.
        run: Digest of the run that wants to go on.

    Raises:
        InputError: The file is damaged, of another format, or another run's.
    """
    if not path.exists():
        return None
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        head = json.loads(arrays.pop(_HEAD).tobytes())
        form, found = head.pop("format"), head.pop("run")
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        expected = "a whole checkpoint (remove it to start afresh)"
        raise InputError(path, expected=expected, found=f"{type(error).__name__}: {error}") from error
    if form != FORMAT:
        raise InputError(path, field="format", expected=f"{FORMAT}", found=form)
    if found != run:
        expected = "a checkpoint of the same start, frames and settings (remove it to start afresh)"
        raise InputError(path, expected=expected, found="another run's")
    return Checkpoint(run, head, arrays)
