"""S3 against a real server, well and badly behaved."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from schemas import object_store, storage
from schemas.errors import InputError, RetryError
from schemas.manifest import commit_unit, committed_units, damage, load_manifest, read_part
from tests.schemas.s3_server import BUCKET, Proxy, address, s3
from tests.workers.fake_steps import answer, unit

pytest.importorskip("moto", reason="moto[server] is not installed")

QUESTIONS = unit(0, ["a", "b"]).questions


def rows(author: str = "") -> dict[str, list[Any]]:
    return {"answers": [answer(question, answer=author) for question in QUESTIONS]}


@pytest.fixture(scope="module")
def proxy() -> Iterator[Proxy]:
    with s3() as found:
        yield found


@pytest.fixture
def place(proxy: Proxy, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A folder of its own in the bucket, and short waits."""
    monkeypatch.setattr(object_store, "WAITS_S", (0.01, 0.02, 0.05))
    yield address(proxy.port, f"a b/{request.node.name}")
    proxy.fault = lambda line: ""


def faults(*kinds: str, method: str = "PUT") -> Callable[[str], str]:
    """Spoil the first requests of a method, one after the other."""
    left = list(kinds)

    def fault(line: str) -> str:
        return left.pop(0) if left and line.startswith(method) else ""

    return fault


def test_files_are_written_read_listed_and_removed(place: str) -> None:
    target = storage.join(place, "deep", "x y.bin")
    assert not storage.exists(target)
    storage.write_bytes_atomic(target, b"one")
    storage.write_bytes_atomic(target, b"two")
    assert storage.read_bytes(target) == b"two"
    assert storage.list_files(place, recursive=True) == ("deep/x y.bin",)
    with storage.local_copy(target) as path:
        assert path.read_bytes() == b"two"
    storage.remove(target)
    storage.remove(target)
    assert not storage.exists(target)
    assert storage.list_files(place, recursive=True) == ()
    with pytest.raises(InputError, match="nothing there"):
        storage.read_bytes(target)


def test_file_is_created_where_none_lies(place: str) -> None:
    target = storage.join(place, "x")
    assert storage.create_bytes(target, b"first")
    assert not storage.create_bytes(target, b"second")
    assert storage.create_bytes(target, b"first"), "the very same content: an earlier try"
    assert storage.read_bytes(target) == b"first"


def test_of_many_creators_at_once_one_wins(place: str) -> None:
    target, won = storage.join(place, "x"), list[int]()

    def create(number: int) -> None:
        if storage.create_bytes(target, str(number).encode()):
            won.append(number)

    threads = [threading.Thread(target=create, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(won) == 1
    assert storage.read_bytes(target) == str(won[0]).encode()


@pytest.mark.parametrize("kind", ["500", "reset", "cut", "lost", "slow"])
def test_create_survives_a_fault_and_knows_its_own_file(place: str, proxy: Proxy, kind: str) -> None:
    target = storage.join(place, "x")
    proxy.fault = faults(kind, kind)
    assert storage.create_bytes(target, b"mine"), "an answer that was lost does not make us second"
    assert not storage.create_bytes(target, b"other")
    assert storage.read_bytes(target) == b"mine"


def test_upload_that_breaks_off_never_appears(place: str, proxy: Proxy) -> None:
    target = storage.join(place, "x")
    storage.write_bytes_atomic(target, b"old" * 1000)
    proxy.fault = faults(*["cut"] * 50)
    with pytest.raises(RetryError):
        storage.write_bytes_atomic(target, b"new" * 1000)
    fresh = storage.join(place, "y")
    with pytest.raises(RetryError):
        storage.create_bytes(fresh, b"new" * 1000)
    proxy.fault = lambda line: ""
    assert storage.read_bytes(target) == b"old" * 1000
    assert not storage.exists(fresh)


@pytest.mark.parametrize("kind", ["500", "reset", "slow"])
def test_reads_and_listings_survive_a_fault(place: str, proxy: Proxy, kind: str) -> None:
    storage.write_bytes_atomic(storage.join(place, "x"), b"1")
    for method in ("GET", "HEAD"):
        proxy.fault = faults(kind, method=method)
        assert storage.read_bytes(storage.join(place, "x")) == b"1"
        proxy.fault = faults(kind, method=method)
        assert storage.list_files(place) == ("x",)
        proxy.fault = faults(kind, method=method)
        assert not storage.exists(storage.join(place, "y"))


def test_store_that_stays_away_is_a_retry_error_after_bounded_tries(
    place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    waited = list[float]()
    monkeypatch.setattr(object_store.time, "sleep", waited.append)
    with pytest.raises(RetryError, match="s3://"):
        storage.create_bytes(address(1), b"x")
    assert waited == list(object_store.WAITS_S)


def test_bucket_that_does_not_exist_is_an_input_error_at_once(place: str) -> None:
    missing = place.replace(f"//{BUCKET}/", "//nothing-here/")
    with pytest.raises(InputError):
        storage.write_bytes_atomic(storage.join(missing, "x"), b"1")


@pytest.mark.parametrize("uri", ["s3://key:secret@bucket/x", "s3://key@bucket/x", "s3://bucket/x?secret_key=abc"])
def test_key_in_a_uri_is_refused_and_not_repeated(uri: str) -> None:
    with pytest.raises(InputError, match="expected keys in the environment") as caught:
        storage.read_bytes(uri)
    assert not any(word in str(caught.value) for word in ("key:secret", "secret@", "key@", "abc"))


def test_store_without_put_if_absent_is_refused() -> None:
    with pytest.raises(InputError, match="a store without put-if-absent"):
        storage.create_bytes("mock:///run/x", b"1")


def test_missing_extra_is_named(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(InputError, match=r"pip install 'splatreasoner\[remote\]'"):
        storage.write_bytes_atomic(storage.join(place, "x"), b"1")


def test_unit_is_committed_once_and_a_second_driver_loses(place: str, proxy: Proxy) -> None:
    proxy.fault = faults("lost", "500", "lost")
    assert commit_unit(place, "u1", rows("first"), epoch=1).won
    late = commit_unit(place, "u1", rows("second"), epoch=2)
    assert (late.won, late.manifest.epoch) == (False, 1)
    assert committed_units(place) == ("u1",)
    assert damage(place, "u1") == ""
    found = read_part(place, load_manifest(place, "u1"), "answers")
    assert set(found["answer"].to_pylist()) == {"first"}
