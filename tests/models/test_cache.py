"""The call cache: what the key sees, damage, crashes, many writers."""

from __future__ import annotations

import json
import multiprocessing
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.models.cache import CallCache, call_key
from pipeline.models.messages import ImagePart, Message, Observation, Reply, Request
from schemas.errors import InputError

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
    with pytest.raises(InputError, match="No space"):
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
