"""Stored replies: counted by client and stage, exported as a table, damaged ones told."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from jobs.stored_replies import contents, export
from pipeline.models.cache import CallCache
from pipeline.models.messages import Reply
from schemas.errors import InputError
from tests.jobs.test_cli import run
from tests.models.test_cache import crashed as crashed

KEYS = [f"{number:x}" * 64 for number in range(4)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    cache = CallCache(tmp_path / "calls")
    for key, stage in zip(KEYS, ("choice", "verify", "verify", "verify"), strict=True):
        cache.put(key, Reply(f"says {key[0]}", 10, 2, "m-1"), stage=stage, client="cloud:m")
    cache.close()  # else the damaged one would be in the log
    cache.path(KEYS[3]).write_text(cache.path(KEYS[3]).read_text().replace("says", "lies"))
    (cache.folder / "journals").mkdir()
    cache.path(KEYS[0]).with_name(".left-by-a-crash.tmp").write_text("{")
    return cache.folder


def test_contents_counts_what_can_be_trusted(folder: Path) -> None:
    found = contents(folder)
    assert {key: (c.replies, c.prompt_tokens, c.completion_tokens) for key, c in found.counts.items()} == {
        ("cloud:m", "choice"): (1, 10, 2),
        ("cloud:m", "verify"): (2, 20, 4),
    }
    assert [path.stem for path in found.damaged] == [KEYS[3]]


def test_export_writes_each_sound_reply_once(folder: Path, tmp_path: Path) -> None:
    assert export(folder, tmp_path / "out.parquet") == 3
    table = pd.read_parquet(tmp_path / "out.parquet")
    assert table["key"].tolist() == KEYS[:3]
    assert table["reply"].tolist() == ["says 0", "says 1", "says 2"]
    assert set(table["endpoint"]) == {"cloud"}
    assert set(table["model"]) == {"m-1"}


def test_contents_of_a_missing_folder_raises(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nothing there"):
        contents(tmp_path / "none")


def test_contents_after_a_crash_counts_what_lies_in_the_log_alone(crashed: Path) -> None:
    files = len(list(crashed.glob("??/*.json")))
    found = contents(crashed)
    assert sum(count.replies for count in found.counts.values()) == 4 > files
    assert not found.damaged


def test_export_after_a_crash_holds_what_lies_in_the_log_alone(crashed: Path, tmp_path: Path) -> None:
    assert export(crashed, tmp_path / "out.parquet") == 4
    assert pd.read_parquet(tmp_path / "out.parquet")["reply"].tolist() == [f"reply {number}" for number in range(4)]


def test_verb_verify_names_damaged_files_and_fails(folder: Path, tmp_path: Path) -> None:
    assert run("cache", "stats", folder).stdout.splitlines()[1].startswith("cloud:m verify: 2 replies, 20 + 4 tokens")
    found = run("cache", "verify", folder)
    assert found.returncode == 1
    assert f"{KEYS[3]}.json" in found.stdout
    assert run("cache", "export", folder).returncode == 2
    assert "3 replies" in run("cache", "export", folder, tmp_path / "a.parquet").stdout
