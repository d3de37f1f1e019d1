"""Object stores and other remote filesystems: read and listed through pyarrow, written through obstore.

pyarrow's writers cannot put an object only where none lies, which a commit needs, so S3, GCS and Azure are written by
`obstore` (extra `remote`): one request an object, which appears whole or not at all. A store that does not answer is
asked again a bounded number of times, with growing waits.
"""

from __future__ import annotations

import posixpath
import re
import time
import uuid
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import parse_qs, unquote, urlsplit

from schemas.errors import InputError, RetryError

if TYPE_CHECKING:
    from pyarrow.fs import FileSystem

T = TypeVar("T")

WAITS_S = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Seconds before each further try: a store that is away for half a minute costs no work."""

OBJECT_STORES = frozenset({"s3", "gcs", "abfs"})
"""pyarrow's names of stores where an object appears whole or not at all; a rename there would be a copy."""

_REFUSED = re.compile(
    r"AWS Error (ACCESS_DENIED|INVALID_ACCESS_KEY_ID|INVALID_CLIENT_TOKEN_ID|SIGNATURE_DOES_NOT_MATCH|NO_SUCH_BUCKET)"
)
"""Answers that will not change: pyarrow raises them as plain OSError, with the store's code in the text."""


def filesystem(uri: str) -> tuple[FileSystem, str]:
    """Return the pyarrow filesystem of a URI, and the path within it.

    Raises:
        InputError: The scheme is unknown, the URI is malformed, or it holds a key: URIs are written down, keys never.
    """
    parts = urlsplit(uri)
    if parts.password or (parts.scheme == "s3" and parts.username) or "secret" in parts.query.lower():
        plain = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
        raise InputError(plain, expected="keys in the environment (AWS_ACCESS_KEY_ID, ...)", found="a key in the URI")
    try:
        store, root = _store(with_path(uri, "/"))
    except (ValueError, OSError, NotImplementedError) as error:
        raise InputError(uri, expected="a path or a URI such as s3://bucket/folder", found=error) from error
    return store, posixpath.join(root, unquote(parts.path).strip("/"))


def with_path(uri: str, path: str) -> str:
    """Return a URI with another path; urlunsplit would drop the empty host of hdfs:///folder and its slashes."""
    parts = urlsplit(uri)
    return f"{parts.scheme}://{parts.netloc}{path}" + (f"?{parts.query}" if parts.query else "")


@lru_cache(maxsize=32)
def _store(root: str) -> tuple[FileSystem, str]:
    """Return the filesystem of a bucket or host, once a process: making an S3 client asks for the bucket's region."""
    from pyarrow.fs import FileSystem

    return FileSystem.from_uri(root)


def read(uri: str) -> bytes:
    """Return a file's content."""

    def once() -> bytes:
        store, inner = filesystem(uri)
        with store.open_input_stream(inner) as stream:
            return bytes(stream.read())

    return _patiently(uri, "a file that can be read", once)


def exists(uri: str) -> bool:
    """Return whether a file or folder is there."""
    from pyarrow.fs import FileType

    def once() -> bool:
        store, inner = filesystem(uri)
        return bool(store.get_file_info(inner).type != FileType.NotFound)

    return _patiently(uri, "a path that can be looked up", once)


def files(uri: str, recursive: bool) -> list[str]:
    """Return the names of the files in a folder, relative to it."""
    from pyarrow.fs import FileSelector, FileType

    def once() -> list[str]:
        store, inner = filesystem(uri)
        base = inner.rstrip("/")
        infos = store.get_file_info(FileSelector(base, allow_not_found=True, recursive=recursive))
        return [info.path.removeprefix(base).lstrip("/") for info in infos if info.type == FileType.File]

    return _patiently(uri, "a folder that can be listed", once)


def write(uri: str, data: bytes) -> None:
    """Write a file so that a reader sees the old content or the new."""

    def once() -> None:
        store, inner = filesystem(uri)
        if store.type_name in OBJECT_STORES:
            _put(uri, inner, data, "overwrite")
            return
        aside = f"{inner}.{uuid.uuid4().hex}.tmp"
        if "/" in inner:
            store.create_dir(inner.rsplit("/", 1)[0], recursive=True)
        with store.open_output_stream(aside) as stream:
            stream.write(data)
        store.move(aside, inner)

    _patiently(uri, "a place that can be written", once)


def create(uri: str, data: bytes) -> bool:
    """Put an object where none lies; see `storage.create_bytes`."""

    def once() -> bool:
        store, inner = filesystem(uri)
        if store.type_name not in OBJECT_STORES:
            raise InputError(
                uri, expected="a local path, s3://, gs:// or abfs://", found="a store without put-if-absent"
            )
        try:
            _put(uri, inner, data, "create")
        except FileExistsError:
            # The answer to an earlier try may have been lost after the object was put.
            try:
                with store.open_input_stream(inner) as stream:
                    return bytes(stream.read()) == data
            except FileNotFoundError:
                return False
        return True

    return _patiently(uri, "a place that can be written", once)


def remove(uri: str) -> None:
    """Remove a file; nothing happens where there is none."""

    def once() -> None:
        store, inner = filesystem(uri)
        try:
            if store.type_name in OBJECT_STORES:
                import obstore

                obstore.delete(_writer(with_path(uri, "/")), inner.partition("/")[2])
            else:
                store.delete_file(inner)
        except FileNotFoundError:
            pass

    _patiently(uri, "a file that can be removed", once)


def _put(uri: str, inner: str, data: bytes, mode: Any) -> None:
    import obstore
    from obstore.exceptions import AlreadyExistsError

    try:
        obstore.put(_writer(with_path(uri, "/")), inner.partition("/")[2], data, mode=mode)
    except AlreadyExistsError as error:
        raise FileExistsError(uri) from error


@lru_cache(maxsize=32)
def _writer(root: str) -> Any:
    """Return obstore's client of a bucket, addressed as pyarrow's is; keys come from the environment."""
    from datetime import timedelta

    from obstore.store import S3Store, from_url

    parts = urlsplit(root)
    options = {name: values[-1] for name, values in parse_qs(parts.query).items()}
    plain = options.get("scheme") == "http"
    shared: dict[str, Any] = {
        "client_options": {"allow_http": True, "timeout": timedelta(seconds=30)},
        "retry_config": {"max_retries": 0, "retry_timeout": timedelta(seconds=60)},
    }
    if parts.scheme != "s3":
        return from_url(with_path(root, "").partition("?")[0], **shared)
    if "endpoint_override" in options:
        shared["endpoint"] = f"{'http' if plain else 'https'}://{options['endpoint_override']}"
    if "region" in options:
        shared["region"] = options["region"]
    return S3Store(parts.netloc, **shared)


def _patiently(uri: str, expected: str, once: Callable[[], T]) -> T:
    """Do something now or, where the store does not answer, again and again, and classify what it raises."""
    for wait_s in (*WAITS_S, None):
        try:
            return once()
        except FileNotFoundError as error:
            raise InputError(uri, expected=expected, found="nothing there") from error
        except (IsADirectoryError, NotADirectoryError, PermissionError) as error:
            raise InputError(uri, expected=expected, found=error.strerror or type(error).__name__) from error
        except ModuleNotFoundError as error:
            needed = "obstore, which writes to object stores: pip install 'splatreasoner[remote]'"
            raise InputError(uri, expected=needed, found=f"no module {error.name}") from error
        except OSError as error:
            if _REFUSED.search(str(error)):
                raise InputError(uri, expected=expected, found=error) from error
            failure: Exception = error
        except Exception as error:
            if type(error).__module__.partition(".")[0] != "obstore":
                raise
            if type(error).__name__ in ("PermissionDeniedError", "UnauthenticatedError", "NotFoundError"):
                raise InputError(uri, expected=expected, found=_first_line(error)) from error
            failure = error
        if wait_s is not None:
            time.sleep(wait_s)
    raise RetryError(f"{uri}: {_first_line(failure)}") from failure


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)
