"""Where bytes lie: local paths and pyarrow-filesystem URIs (file, s3, gs, ...) behind one set of functions.

A local path never touches pyarrow, so reading one costs no import. Errors are classified here, by type: a name that
is wrong is an InputError, a remote store that does not answer is a RetryError.
"""

from __future__ import annotations

import os
import posixpath
import re
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, unquote, urlsplit

from schemas.errors import InputError, RetryError

if TYPE_CHECKING:
    from pyarrow.fs import FileSystem

_SCHEME = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]+://")
"""Two letters or more, so that a Windows drive is a path."""

ATOMIC_PUT = frozenset({"s3", "gcs", "abfs"})
"""Stores where an object appears whole or not at all; a rename there would be a copy."""


def local_path(uri: str | os.PathLike[str]) -> Path | None:
    """Return the local path a path or file:// URI names; None for any other URI."""
    text = os.fspath(uri)
    if not _SCHEME.match(text):
        return Path(text)
    parts = urlsplit(text)
    return Path(unquote(parts.path)) if parts.scheme == "file" and parts.netloc in ("", "localhost") else None


def filesystem(uri: str | os.PathLike[str]) -> tuple[FileSystem, str]:
    """Return the pyarrow filesystem of a path or URI, and the path within it.

    Raises:
        InputError: The scheme is unknown or the URI is malformed.
    """
    path = local_path(uri)
    if path is not None:
        from pyarrow.fs import LocalFileSystem

        return LocalFileSystem(), str(path)
    text = os.fspath(uri)
    try:
        store, root = _store(_with_path(text, "/"))
    except (ValueError, OSError, NotImplementedError) as error:
        raise InputError(uri, expected="a path or a URI such as s3://bucket/folder", found=error) from error
    return store, posixpath.join(root, unquote(urlsplit(text).path).strip("/"))


def _with_path(uri: str, path: str) -> str:
    """Return a URI with another path; urlunsplit would drop the empty host of hdfs:///folder and its slashes."""
    parts = urlsplit(uri)
    return f"{parts.scheme}://{parts.netloc}{path}" + (f"?{parts.query}" if parts.query else "")


@lru_cache(maxsize=32)
def _store(root: str) -> tuple[FileSystem, str]:
    """Return the filesystem of a bucket or host, once a process: making an S3 client asks for the bucket's region."""
    from pyarrow.fs import FileSystem

    return FileSystem.from_uri(root)


def join(uri: str | os.PathLike[str], *names: str) -> str:
    """Return the path or URI of `names` below `uri`; a name may hold slashes, and is quoted where URIs need it."""
    text = os.fspath(uri)
    if not _SCHEME.match(text):
        return str(Path(text, *names))
    return _with_path(text, "/".join([urlsplit(text).path.rstrip("/"), *(quote(name.strip("/")) for name in names)]))


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
    with _classified(uri, "a file that can be read"):
        if path is not None:
            return path.read_bytes()
        store, inner = filesystem(uri)
        with store.open_input_stream(inner) as stream:
            return bytes(stream.read())


def exists(uri: str | os.PathLike[str]) -> bool:
    """Return whether a file or folder is there.

    Raises:
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    if path is not None:
        return path.exists()
    from pyarrow.fs import FileType

    with _classified(uri, "a path that can be looked up"):
        store, inner = filesystem(uri)
        return bool(store.get_file_info(inner).type != FileType.NotFound)


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
    with _classified(uri, "a folder that can be listed"):
        if path is not None:
            found = path.rglob("*") if recursive else path.glob("*")
            return tuple(sorted(p.relative_to(path).as_posix() for p in found if p.is_file()))
        from pyarrow.fs import FileSelector, FileType

        store, inner = filesystem(uri)
        base = inner.rstrip("/")
        infos = store.get_file_info(FileSelector(base, allow_not_found=True, recursive=recursive))
        return tuple(sorted(info.path.removeprefix(base).lstrip("/") for info in infos if info.type == FileType.File))


def write_bytes_atomic(uri: str | os.PathLike[str], data: bytes) -> None:
    """Write a file so that a reader sees the old content or the new, never a part.

    Local: a temporary file beside the target, fsync, rename, fsync of the folder; missing folders are made. Object
    stores publish an object only when its upload ends. Other filesystems: a temporary file, then a move.

    Raises:
        InputError: The place may not be written.
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    with _classified(uri, "a place that can be written"):
        if path is not None:
            _write_local(path, data)
            return
        store, inner = filesystem(uri)
        direct = store.type_name in ATOMIC_PUT
        target = inner if direct else f"{inner}.{uuid.uuid4().hex}.tmp"
        if not direct and "/" in inner:
            store.create_dir(inner.rsplit("/", 1)[0], recursive=True)
        with store.open_output_stream(target) as stream:
            stream.write(data)
        if not direct:
            store.move(target, inner)


def remove(uri: str | os.PathLike[str]) -> None:
    """Remove a file; nothing happens where there is none.

    Raises:
        InputError: It may not be removed, or is a folder.
        RetryError: A remote store failed to answer.
    """
    path = local_path(uri)
    with _classified(uri, "a file that can be removed"):
        if path is not None:
            path.unlink(missing_ok=True)
        elif exists(uri):
            store, inner = filesystem(uri)
            store.delete_file(inner)


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


def _write_local(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}.tmp")
    try:
        with temporary.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


@contextmanager
def _classified(uri: str | os.PathLike[str], expected: str) -> Iterator[None]:
    """Turn what filesystems raise into this project's errors."""
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(uri, expected=expected, found="nothing there") from error
    except (IsADirectoryError, NotADirectoryError, PermissionError, FileExistsError) as error:
        raise InputError(uri, expected=expected, found=error.strerror or type(error).__name__) from error
    except OSError as error:
        if local_path(uri) is not None:
            raise InputError(uri, expected=expected, found=error.strerror or error) from error
        raise RetryError(f"{os.fspath(uri)}: {error}") from error
