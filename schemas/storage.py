"""Where bytes lie: local paths and pyarrow-filesystem URIs (file, s3, gs, ...) behind one set of functions.

A local path never touches pyarrow, so reading one costs no import. Errors are classified here and in `object_store`,
by type: a name that is wrong is an InputError, a disk that is full a StopError, a remote store that still does not
answer after several tries a RetryError.
"""

from __future__ import annotations

import errno
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

from schemas import local_files, object_store
from schemas.errors import InputError, StopError

_SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]+://")
"""Two letters or more, so that a Windows drive is a path."""

_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO})
"""A disk that takes no more: nothing further can be committed, and what is committed stays."""


def local_path(uri: str | os.PathLike[str]) -> Path | None:
    """Return the local path a path or file:// URI names; None for any other URI."""
    text = os.fspath(uri)
    if not _SCHEME.match(text):
        return Path(text)
    parts = urlsplit(text)
    return Path(unquote(parts.path)) if parts.scheme == "file" and parts.netloc in ("", "localhost") else None


def join(uri: str | os.PathLike[str], *names: str) -> str:
    """Return the path or URI of `names` below `uri`; a name may hold slashes, and is quoted where URIs need it."""
    text = os.fspath(uri)
    if not _SCHEME.match(text):
        return str(Path(text, *names))
    return object_store.with_path(
        text, "/".join([urlsplit(text).path.rstrip("/"), *(quote(name.strip("/")) for name in names)])
    )


def name_of(uri: str | os.PathLike[str]) -> str:
    """Return the last name of a path or URI, such as the folder's own name."""
    path = local_path(uri)
    if path is not None:
        return path.resolve().name
    return unquote(urlsplit(os.fspath(uri)).path.rstrip("/").split("/")[-1])


def read_bytes(uri: str | os.PathLike[str]) -> bytes:
    """Return the whole content of a file.

    Raises:
        InputError: There is no such file, it is a folder, or it may not be read.
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    if path is None:
        return object_store.read(os.fspath(uri))
    with _classified(uri, "a file that can be read"):
        return local_files.DISK.read(path)


def exists(uri: str | os.PathLike[str]) -> bool:
    """Return whether a file or folder is there.

    Raises:
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    return object_store.exists(os.fspath(uri)) if path is None else local_files.DISK.exists(path)


def list_files(uri: str | os.PathLike[str], *, recursive: bool = False) -> tuple[str, ...]:
    """Return the sorted names, relative to `uri`, of the files in a folder; empty where there is no such folder.

    Args:
        uri: The folder.
        recursive: Also list files in folders below, as "folder/file".

    Raises:
        InputError: The folder may not be read.
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    if path is None:
        return tuple(sorted(object_store.files(os.fspath(uri), recursive)))
    with _classified(uri, "a folder that can be listed"):
        return tuple(sorted(local_files.DISK.files(path, recursive)))


def write_bytes_atomic(uri: str | os.PathLike[str], data: bytes) -> None:
    """Write a file so that a reader sees the old content or the new, never a part.

    Local: a temporary file beside the target, fsync, rename, fsync of the folder; missing folders are made. Object
    stores publish an object only when its upload ends. Other filesystems: a temporary file, then a move.

    Raises:
        InputError: The place may not be written.
        StopError: The disk takes no more.
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    if path is None:
        object_store.write(os.fspath(uri), data)
        return
    with _classified(uri, "a place that can be written"):
        local_files.write_whole(path, data)


def create_bytes(uri: str | os.PathLike[str], data: bytes) -> bool:
    """Put a file where nothing lies; of several writers at once, on any machines, exactly one does.

    Local: a hard link, which fails where the name is taken. Object stores: a conditional put (If-None-Match: *).

    Returns:
        True when this very content lies there now: by this call, or since an earlier try of it whose answer was lost.
        False when something else was there first; it is left as it is.

    Raises:
        InputError: The place may not be written, or its filesystem cannot do this.
        StopError: The disk takes no more.
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    if path is None:
        return object_store.create(os.fspath(uri), data)
    with _classified(uri, "a place that can be written"):
        try:
            return local_files.create(path, data)
        except OSError as error:
            if error.errno in local_files.NO_LINKS:
                raise InputError(uri, expected="a file system with hard links", found=error.strerror) from error
            raise


def remove(uri: str | os.PathLike[str]) -> None:
    """Remove a file; nothing happens where there is none.

    Raises:
        InputError: It may not be removed, or is a folder.
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    if path is None:
        object_store.remove(os.fspath(uri))
        return
    with _classified(uri, "a file that can be removed"):
        local_files.DISK.unlink(path)


@contextmanager
def local_copy(uri: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a local path with the content of a file: the file itself where it is local, else a temporary copy.

    Raises:
        InputError: There is no such file, or it may not be read.
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    if path is not None:
        if not path.exists():
            raise InputError(uri, expected="a file", found="nothing there")
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="splatreasoner-") as folder:
        copy = Path(folder, name_of(uri))
        copy.write_bytes(read_bytes(uri))
        yield copy


@contextmanager
def _classified(uri: str | os.PathLike[str], expected: str) -> Iterator[None]:
    """Turn what the operating system raises about a local file into this project's errors."""
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(uri, expected=expected, found="nothing there") from error
    except IsADirectoryError as error:
        raise InputError(uri, expected=expected, found="a folder") from error
    except OSError as error:
        found = error.strerror or type(error).__name__
        if error.errno in _NO_ROOM:
            raise StopError(f"{os.fspath(uri)}: {found}: make room, then resume") from error
        raise InputError(uri, expected=expected, found=found) from error
