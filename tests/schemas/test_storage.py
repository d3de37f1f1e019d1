"""Storage: local paths and remote filesystems behave alike, and failures come as this project's errors."""

from __future__ import annotations

import errno
import os
import shutil
import threading
from pathlib import Path

import pyarrow.fs
import pytest

from schemas import object_store, storage
from schemas.errors import InputError, RetryError, StopError

FAKE = "fake://bucket"


@pytest.fixture
def remote(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> pyarrow.fs.SubTreeFileSystem:
    """A filesystem behind fake:// URIs: a folder that only pyarrow knows the place of."""
    (tmp_path / "remote" / "bucket").mkdir(parents=True)
    store = pyarrow.fs.SubTreeFileSystem(str(tmp_path / "remote"), pyarrow.fs.LocalFileSystem())

    def lookup(uri: str) -> tuple[pyarrow.fs.FileSystem, str]:
        assert str(uri).startswith("fake://"), f"{uri} went to the remote store"
        return store, storage.unquote(str(uri).removeprefix("fake://"))

    monkeypatch.setattr(object_store, "filesystem", lookup)
    return store


@pytest.fixture(params=["path", "file uri", "remote"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A folder, as each kind of address."""
    if request.param == "remote":
        request.getfixturevalue("remote")
        return FAKE
    folder = tmp_path / "a folder"
    folder.mkdir()
    return str(folder) if request.param == "path" else folder.as_uri()


class TestEveryPlace:
    def test_written_bytes_read_back(self, place: str) -> None:
        target = storage.join(place, "deep", "er", "x y.bin")
        storage.write_bytes_atomic(target, b"one")
        storage.write_bytes_atomic(target, b"two")
        assert storage.read_bytes(target) == b"two"
        assert storage.exists(target)
        assert storage.exists(storage.join(place, "deep"))

    def test_files_are_listed_sorted_and_nothing_temporary_is_left(self, place: str) -> None:
        for name in ("b.txt", "a b.txt", "sub/c.txt"):
            storage.write_bytes_atomic(storage.join(place, name), b"x")
        assert storage.list_files(place) == ("a b.txt", "b.txt")
        assert storage.list_files(place, recursive=True) == ("a b.txt", "b.txt", "sub/c.txt")
        assert storage.list_files(storage.join(place, "sub")) == ("c.txt",)

    def test_missing_things_are_absent_empty_or_an_input_error(self, place: str) -> None:
        missing = storage.join(place, "no", "such")
        assert not storage.exists(missing)
        assert storage.list_files(missing) == ()
        with pytest.raises(InputError, match="nothing there"):
            storage.read_bytes(missing)
        with pytest.raises(InputError), storage.local_copy(missing):
            pass

    def test_removed_file_is_gone_and_removing_nothing_is_fine(self, place: str) -> None:
        target = storage.join(place, "sub", "x")
        storage.remove(target)
        storage.write_bytes_atomic(target, b"x")
        storage.remove(target)
        assert not storage.exists(target)

    def test_local_copy_has_the_content_and_the_name(self, place: str) -> None:
        target = storage.join(place, "x.bin")
        storage.write_bytes_atomic(target, b"content")
        with storage.local_copy(target) as path:
            assert path.read_bytes() == b"content"
            assert path.name == "x.bin"


def test_local_copy_of_a_local_file_is_the_file(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"1")
    with storage.local_copy(str(tmp_path / "x")) as path:
        assert path == tmp_path / "x"


def test_local_copy_of_a_remote_file_is_removed_afterwards(remote: pyarrow.fs.FileSystem) -> None:
    storage.write_bytes_atomic(f"{FAKE}/x", b"1")
    with storage.local_copy(f"{FAKE}/x") as path:
        assert path.exists()
    assert not path.exists()


@pytest.mark.parametrize(
    ("base", "names", "expected"),
    [
        ("/data/run", ("t", "p.parquet"), "/data/run/t/p.parquet"),
        ("run", ("t",), "run/t"),
        ("s3://b/run/", ("t", "a b.json"), "s3://b/run/t/a%20b.json"),
        ("s3://b/run?region=eu", ("sub/x",), "s3://b/run/sub/x?region=eu"),
        ("gs://b", ("x",), "gs://b/x"),
        ("hdfs:///a/", ("x", "y"), "hdfs:///a/x/y"),
        ("file:///a", ("x y",), "file:///a/x%20y"),
    ],
)
def test_join_keeps_the_kind_of_address(base: str, names: tuple[str, ...], expected: str) -> None:
    assert storage.join(base, *names) == expected


@pytest.mark.parametrize(
    ("uri", "expected"),
    [("/a/b", "/a/b"), ("a", "a"), ("file:///a/x%20y", "/a/x y"), ("s3://b/k", None), ("C:/scenes", "C:/scenes")],
)
def test_local_path_knows_local_addresses(uri: str, expected: str | None) -> None:
    path = storage.local_path(uri)
    assert (None if path is None else path.as_posix()) == expected


def test_name_of_is_the_last_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert storage.name_of("s3://b/scenes/flat%201/") == "flat 1"
    assert storage.name_of("/a/flat/") == "flat"
    monkeypatch.chdir(tmp_path)
    assert storage.name_of(".") == tmp_path.name


@pytest.mark.parametrize(
    ("uri", "inner"),
    [
        ("s3://bucket/a%20b/c?region=us-east-1", "bucket/a b/c"),
        ("s3://bucket?region=us-east-1", "bucket"),
        ("gs://anonymous@bucket/x", "bucket/x"),
        ("mock:///a/b", "a/b"),
    ],
)
def test_filesystem_gives_the_path_within_the_store_and_is_made_once(uri: str, inner: str) -> None:
    store, path = object_store.filesystem(uri)
    assert path.rstrip("/") == inner
    assert object_store.filesystem(uri)[0] is store


def test_a_store_of_pyarrow_itself_holds_what_was_written() -> None:
    storage.write_bytes_atomic("mock:///run/part", b"1")
    assert storage.read_bytes("mock:///run/part") == b"1"
    assert storage.list_files("mock:///run") == ("part",)


def test_unknown_scheme_is_an_input_error() -> None:
    with pytest.raises(InputError, match="expected a path or a URI"):
        storage.read_bytes("teleport://bucket/x")


def test_folder_in_place_of_a_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found a folder"):
        storage.read_bytes(str(tmp_path))
    with pytest.raises(InputError):
        storage.write_bytes_atomic(str(tmp_path), b"x")
    assert list(tmp_path.parent.glob(".*.tmp")) == []


def test_file_in_place_of_a_folder_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError):
        storage.write_bytes_atomic(str(tmp_path / "file" / "x"), b"x")


def test_remote_failure_is_a_retry_error(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def open_input_stream(self, path: str) -> None:
            raise OSError("AWS Error NETWORK_CONNECTION during GetObject")

    monkeypatch.setattr(object_store, "filesystem", lambda uri: (Broken(), "x"))
    monkeypatch.setattr(object_store, "WAITS_S", (0.01,))
    with pytest.raises(RetryError, match="NETWORK_CONNECTION"):
        storage.read_bytes("s3://b/x")


def test_failed_local_write_keeps_the_old_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "x"
    storage.write_bytes_atomic(str(target), b"old")

    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StopError, match="No space left"):
        storage.write_bytes_atomic(str(target), b"new")
    assert target.read_bytes() == b"old"
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO])
def test_disk_that_takes_no_more_stops_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int) -> None:
    def full(fd: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "fsync", full)
    for write in (storage.write_bytes_atomic, storage.create_bytes):
        with pytest.raises(StopError, match="make room, then resume"):
            write(str(tmp_path / "x"), b"new")
    assert list(tmp_path.iterdir()) == []


class TestCreate:
    def test_first_content_stays(self, tmp_path: Path) -> None:
        target = str(tmp_path / "deep" / "x")
        assert storage.create_bytes(target, b"first")
        assert not storage.create_bytes(target, b"second")
        assert storage.create_bytes(target, b"first"), "the very same content counts as ours"
        assert storage.read_bytes(target) == b"first"
        assert [path.name for path in (tmp_path / "deep").iterdir()] == ["x"]

    def test_of_many_creators_at_once_one_wins(self, tmp_path: Path) -> None:
        target, won = str(tmp_path / "x"), list[int]()

        def create(number: int) -> None:
            if storage.create_bytes(target, str(number).encode()):
                won.append(number)

        threads = [threading.Thread(target=create, args=(number,)) for number in range(16)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(won) == 1
        assert storage.read_bytes(target) == str(won[0]).encode()

    def test_file_system_without_hard_links_is_refused(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def no_links(path: object, target: object) -> None:
            raise OSError(errno.EPERM, "Operation not permitted")

        monkeypatch.setattr(os, "link", no_links)
        with pytest.raises(InputError, match="expected a file system with hard links"):
            storage.create_bytes(str(tmp_path / "x"), b"1")
        assert list(tmp_path.iterdir()) == []


def test_folder_that_was_removed_meanwhile_is_made_again(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b" / "x"
    storage.write_bytes_atomic(str(target), b"1")
    shutil.rmtree(tmp_path / "a")
    storage.write_bytes_atomic(str(target), b"2")
    assert target.read_bytes() == b"2"


def test_reading_a_local_file_imports_no_pyarrow(tmp_path: Path) -> None:
    import subprocess
    import sys

    (tmp_path / "x").write_bytes(b"1")
    read = f"from schemas.storage import read_bytes; read_bytes({str(tmp_path / 'x')!r})"
    code = f"import sys; {read}; print('pyarrow' in sys.modules)"
    root = Path(storage.__file__).parent.parent
    out = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True).stdout
    assert out.strip() == "False"
