"""The call cache: what the key sees, damage, crashes, many writers."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.models import cache as cache_module
from pipeline.models.cache import LOGS, CallCache, GroupedPuts, NewReply, call_key
from pipeline.models.file_log import FileLog, settle
from pipeline.models.messages import ImagePart, Message, Observation, Reply, Request
from schemas.errors import InputError, StopError

KEY = "ab" + "0" * 62
REPLY = Reply("On the desk.\nüñ 青 \ud800", 12, 3, "m-1")
IDENTITY = {"kind": "openai", "model": "m", "temperature": 0.0}


def _image(value: int = 7, shape: tuple[int, int, int] = (2, 3, 3)) -> ImagePart:
    return ImagePart(np.full(shape, value, np.uint8))


def _request(*parts: Any, stage: Any = "choice", role: Any = "user", variables: Any = None) -> Request:
    return Request(stage, (Message(role, parts or ("text",)),), variables or {})


def test_call_key_is_the_same_for_the_same_call() -> None:
    first = call_key(IDENTITY, _request("a", _image()))
    assert first == call_key(dict(reversed(IDENTITY.items())), _request("a", _image()))
    assert len(first) == 64


def test_call_key_changes_with_all_that_counts() -> None:
    observation = Observation(
        np.zeros((2, 3), np.int32), np.zeros((2, 3)), np.eye(3), np.array([0.0, -1.0, 0.0]), ("lamp",)
    )
    requests = [
        _request("a"),
        _request("b"),
        _request("a", "b"),
        _request("ab"),
        _request("a", role="system"),
        _request("a", stage="verify"),
        _request("a", variables={"k": 1}),
        _request("a", variables={"k": 2}),
        _request("a", _image()),
        _request(_image(), "a"),
        _request("a", _image(8)),
        _request("a", _image(shape=(3, 2, 3))),
        _request("a", ImagePart(_image().color, observation)),
    ]
    keys = [call_key(IDENTITY, request) for request in requests]
    keys += [call_key({**IDENTITY, "model": "n"}, requests[0]), call_key({**IDENTITY, "seed": 1}, requests[0])]
    assert len(set(keys)) == len(keys)


@given(st.lists(st.text(), min_size=1, max_size=4), st.lists(st.text(), min_size=1, max_size=4))
def test_call_key_differs_for_different_parts(first: list[str], second: list[str]) -> None:
    same = call_key(IDENTITY, _request(*first)) == call_key(IDENTITY, _request(*second))
    assert same == (first == second)


def test_call_key_variable_that_is_not_json_raises() -> None:
    with pytest.raises(InputError, match="variables"):
        call_key(IDENTITY, _request("a", variables={"k": object()}))
    with pytest.raises(InputError, match="variables"):
        call_key(IDENTITY, _request("a", variables={"k": float("nan")}))


def test_put_then_get_returns_the_reply(tmp_path: Path) -> None:
    cache = CallCache(tmp_path / "calls")
    assert cache.get(KEY) is None
    cache.put(KEY, REPLY, stage="choice", client="local:m")
    assert cache.get(KEY) == REPLY
    assert CallCache(tmp_path / "calls").get(KEY) == REPLY
    assert cache.path(KEY) == tmp_path / "calls" / "ab" / f"{KEY}.json"
    assert (cache.counts.hits, cache.counts.misses, cache.counts.stored, cache.counts.damaged) == (1, 1, 1, 0)
    assert [p.name for p in (tmp_path / "calls" / "ab").iterdir()] == [f"{KEY}.json"]


@given(st.text(), st.integers(0, 10**9), st.text(max_size=20))
@settings(deadline=None)  # the disk may have other things to do
def test_put_then_get_any_text(tmp_path_factory: pytest.TempPathFactory, text: str, tokens: int, model: str) -> None:
    cache = CallCache(tmp_path_factory.mktemp("calls"))
    cache.put(KEY, Reply(text, tokens, 1, model))
    assert cache.get(KEY) == Reply(text, tokens, 1, model)


def test_get_any_flipped_byte_gives_absent_or_the_same_reply(tmp_path: Path) -> None:
    cache = CallCache(tmp_path)
    cache.put(KEY, REPLY, stage="choice")
    path = cache.path(KEY)
    content = path.read_bytes()
    for place in range(len(content)):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        assert CallCache(tmp_path).get(KEY) in (None, REPLY)
    for length in range(len(content)):
        path.write_bytes(content[:length])
        assert CallCache(tmp_path).get(KEY) is None


@pytest.mark.parametrize("content", [b"", b"[]", b"null", b"{}", b"\xff", b'{"reply": null}', b"[" * 100_000])
def test_get_damaged_entry_is_absent_and_counted_and_can_be_replaced(tmp_path: Path, content: bytes) -> None:
    cache = CallCache(tmp_path)
    cache.path(KEY).parent.mkdir()
    cache.path(KEY).write_bytes(content)
    assert cache.get(KEY) is None
    assert cache.counts.damaged == 1
    cache.put(KEY, REPLY)
    assert cache.get(KEY) == REPLY


def test_get_entry_of_another_key_is_damaged(tmp_path: Path) -> None:
    cache = CallCache(tmp_path)
    cache.put(KEY, REPLY)
    other = "ab" + "1" * 62
    cache.path(KEY).rename(cache.path(other))
    assert cache.get(other) is None
    assert cache.counts.damaged == 1


def test_put_that_fails_leaves_neither_entry_nor_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full_disk(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    cache = CallCache(tmp_path)
    cache.path(KEY).parent.mkdir()
    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(StopError, match="No space"):
        cache.put(KEY, REPLY)
    assert list(cache.path(KEY).parent.iterdir()) == []


def test_entry_is_plain_json_for_people(tmp_path: Path) -> None:
    cache = CallCache(tmp_path)
    cache.put(KEY, Reply("red"), stage="choice", client="local:m")
    entry = json.loads(cache.path(KEY).read_text())
    assert entry["reply"]["text"] == "red"
    assert (entry["key"], entry["stage"], entry["client"]) == (KEY, "choice", "local:m")


def _write_many(folder: Path, writer: int) -> int:
    cache = CallCache(folder)
    for number in range(20):
        key = f"{number:064x}"
        cache.put(key, Reply(f"reply {number}", writer))
        read = cache.get(key)
        assert read is not None
        assert read.text == f"reply {number}"
    return cache.counts.damaged


def test_many_processes_share_a_folder(tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(3) as pool:
        damaged = pool.starmap(_write_many, [(tmp_path, writer) for writer in range(3)])
    assert damaged == [0, 0, 0]
    assert sorted(p.name for p in (tmp_path / "00").iterdir()) == [f"{n:064x}.json" for n in range(20)]


def _logs(folder: Path) -> list[Path]:
    return sorted((folder / LOGS).glob("*.jsonl"))


def _killed_after_puts(folder: Path, count: int) -> None:
    """Store replies in a process that then dies with its log."""
    process = multiprocessing.get_context("spawn").Process(target=_put_and_die, args=(folder, count))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL


def _put_and_die(folder: Path, count: int) -> None:
    cache = CallCache(folder)
    cache.put_all([NewReply(f"{number:064x}", Reply(f"reply {number}")) for number in range(count)])
    os.kill(os.getpid(), signal.SIGKILL)


def _texts(cache: CallCache, count: int) -> list[str | None]:
    found = [cache.get(f"{number:064x}") for number in range(count)]
    return [None if reply is None else reply.text for reply in found]


def _texts_of_four(folder: Path) -> list[str | None]:
    return _texts(CallCache(folder), 4)


@pytest.fixture
def crashed(tmp_path: Path) -> Path:
    """A folder of four replies as a crash of the machine may leave it: of their files one is whole."""
    _killed_after_puts(tmp_path, 4)
    place = CallCache(tmp_path).path
    place(f"{0:064x}").unlink()
    place(f"{1:064x}").write_bytes(b"")
    place(f"{2:064x}").write_bytes(b"\0" * 200)
    return tmp_path


def test_get_after_kill_finds_files_that_the_log_is_not_needed_for(tmp_path: Path) -> None:
    _killed_after_puts(tmp_path, 3)
    for path in _logs(tmp_path):
        path.unlink()
    assert _texts(CallCache(tmp_path), 3) == ["reply 0", "reply 1", "reply 2"]


def test_get_after_crash_finds_what_the_log_holds_and_drops_the_log(crashed: Path) -> None:
    assert len(_logs(crashed)) == 1
    cache = CallCache(crashed)
    assert _texts(cache, 4) == [f"reply {number}" for number in range(4)]
    assert (cache.counts.hits, cache.counts.damaged) == (4, 0)
    assert _logs(crashed) == []


def test_get_after_crash_without_log_takes_torn_files_as_absent(crashed: Path) -> None:
    _logs(crashed)[0].unlink()
    cache = CallCache(crashed)
    assert _texts(cache, 4) == [None, None, None, "reply 3"]
    assert (cache.counts.misses, cache.counts.damaged) == (1, 2)


def test_restore_log_cut_anywhere_gives_back_its_whole_lines(crashed: Path) -> None:
    (path,) = _logs(crashed)
    log, torn = path.read_bytes(), CallCache(crashed).path(f"{1:064x}")
    end = log.index(b"\n")
    for length in (0, 1, end - 1, end, end + 1, len(log) - 2):
        CallCache(crashed).path(f"{0:064x}").unlink(missing_ok=True)
        torn.write_bytes(b"")
        path.write_bytes(log[:length])
        lines = log[:length].count(b"\n") if length != end else 1
        assert _texts(CallCache(crashed), 2) == ["reply 0" if lines else None, "reply 1" if lines > 1 else None]


def test_restore_log_with_a_damaged_line_gives_back_the_others(crashed: Path) -> None:
    (path,) = _logs(crashed)
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([b"\0" * len(lines[0]), lines[1].replace(b"reply 1", b"reply 9"), *lines[2:]]))
    assert _texts(CallCache(crashed), 4) == [None, None, "reply 2", "reply 3"]


def test_restore_leaves_the_log_of_a_process_at_work(tmp_path: Path) -> None:
    at_work = CallCache(tmp_path)
    at_work.put(KEY, REPLY)
    assert CallCache(tmp_path).get(KEY) == REPLY
    assert len(_logs(tmp_path)) == 1
    at_work.close()
    assert _logs(tmp_path) == []


def test_restore_by_many_processes_finds_all_in_each(crashed: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(3) as pool:
        found = pool.map(_texts_of_four, [crashed] * 3)
    assert found == [[f"reply {number}" for number in range(4)]] * 3


def test_put_syncs_files_and_drops_the_log_when_it_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settled = list[int]()

    def noted(log: FileLog) -> None:
        settled.append(len(log.paths))
        settle(log)

    monkeypatch.setattr(cache_module, "settle", noted)
    monkeypatch.setattr(cache_module, "REPLIES_A_LOG", 3)
    cache = CallCache(tmp_path)
    for number in range(7):
        cache.put(f"{number:064x}", Reply(f"reply {number}"))
    cache.close()
    assert _logs(tmp_path) == []
    assert settled[0] == 3
    assert sum(settled) == 7
    cache.put(KEY, REPLY)
    assert len(_logs(tmp_path)) == 1
    cache.close()
    assert _texts(CallCache(tmp_path), 7) == [f"reply {number}" for number in range(7)]


def test_close_that_cannot_sync_raises_and_leaves_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken_disk(descriptor: int) -> None:
        raise OSError(5, "Input/output error")

    cache = CallCache(tmp_path)
    cache.put(KEY, REPLY)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", broken_disk)
        with pytest.raises(StopError, match="Input/output"):
            cache.close()
    assert len(_logs(tmp_path)) == 1
    cache.path(KEY).unlink()
    assert CallCache(tmp_path).get(KEY) == REPLY


def test_grouped_puts_are_stored_when_they_return(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced, sync = list[int](), os.fsync

    def noted(file: int) -> None:
        synced.append(file)
        sync(file)

    monkeypatch.setattr(os, "fsync", noted)

    async def put(puts: GroupedPuts, number: int) -> None:
        await puts.put(NewReply(f"{number:064x}", Reply(f"reply {number}")))
        (log,) = _logs(tmp_path)
        assert f"reply {number}".encode() in log.read_bytes()

    async def run() -> None:
        puts = GroupedPuts(CallCache(tmp_path))
        await asyncio.gather(*(put(puts, number) for number in range(20)))

    asyncio.run(run())
    assert len(synced) < 20, "one sync for many"
    assert _texts(CallCache(tmp_path), 20) == [f"reply {number}" for number in range(20)]


def test_grouped_puts_that_fail_raise_an_error_of_its_own_to_each(tmp_path: Path) -> None:
    (tmp_path / "calls").write_text("a file where the folder should be")

    async def run() -> list[BaseException | None]:
        puts = GroupedPuts(CallCache(tmp_path / "calls"))
        new = [NewReply(f"{number:064x}", REPLY) for number in range(3)]
        return await asyncio.gather(*(puts.put(one) for one in new), return_exceptions=True)

    errors = asyncio.run(run())
    assert [type(error) for error in errors] == [InputError] * 3
    assert len({id(error) for error in errors}) == 3
