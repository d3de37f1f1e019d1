from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import pytest

from schemas import storage
from schemas.errors import InputError
from schemas.manifest import (
    all_manifests,
    commit_unit,
    committed_units,
    damage,
    damaged_units,
    discard_unit,
    load_manifest,
    manifest_uri,
    read_part,
)
from schemas.manifest_file import sealed
from tests.workers.fake_steps import answer, arm, unit

QUESTIONS = unit(0, ["a", "b", "c"]).questions
ROWS: dict[str, list[Any]] = {
    "answers": [answer(q, status=s) for q, s in zip(QUESTIONS, ("answered", "failed", "answered"), strict=True)],
    "arms": [arm(q, "final") for q in QUESTIONS],
    "regions": [],
}


def test_committed_unit_reads_back_verified(tmp_path: Path) -> None:
    run = str(tmp_path)
    manifest = commit_unit(run, "u1", ROWS).manifest
    assert load_manifest(run, "u1") == manifest
    assert (manifest.questions, dict(manifest.statuses)) == (3, {"answered": 2, "failed": 1})
    assert set(manifest.parts) == {"answers", "arms"}, "a table without rows has no part"
    assert read_part(run, manifest, "answers").num_rows == 3
    assert read_part(run, manifest, "regions").num_rows == 0
    assert committed_units(run) == ("u1",)
    assert damage(run, "u1") == ""


def test_commit_that_stops_at_any_write_shows_nothing_or_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, whole = storage.write_bytes_atomic, len(ROWS["answers"])
    for allowed in range(4):
        run, left = str(tmp_path / str(allowed)), [allowed]

        def limited(uri: str, data: bytes, left: list[int] = left) -> None:
            if not left[0]:
                raise OSError("power cut")
            left[0] -= 1
            write(uri, data)

        monkeypatch.setattr(storage, "write_bytes_atomic", limited)
        try:
            commit_unit(run, "u1", ROWS)
        except OSError:
            assert allowed < 3
            assert committed_units(run) == ()
            monkeypatch.setattr(storage, "write_bytes_atomic", write)
            commit_unit(run, "u1", ROWS)
        assert read_part(run, load_manifest(run, "u1"), "answers").num_rows == whole


def test_second_commit_loses_and_leaves_the_first_as_it_is(tmp_path: Path) -> None:
    run, other = str(tmp_path), {"answers": [answer(q, answer="other") for q in QUESTIONS]}
    first = commit_unit(run, "u1", ROWS, epoch=1)
    second = commit_unit(run, "u1", other, epoch=2)
    assert (first.won, second.won) == (True, False)
    assert second.manifest == first.manifest == load_manifest(run, "u1")
    assert set(read_part(run, second.manifest, "answers")["answer"].to_pylist()) == {""}
    assert first.manifest.epoch == 1


def test_same_commit_again_is_the_same_commit(tmp_path: Path) -> None:
    run = str(tmp_path)
    assert commit_unit(run, "u1", ROWS).won
    assert commit_unit(run, "u1", ROWS).won, "an answer that was lost on the way: the very same bytes lie there"
    assert committed_units(run) == ("u1",)


def test_discarded_unit_is_pending_and_its_files_stay(tmp_path: Path) -> None:
    run, other = str(tmp_path), {"answers": [answer(q, answer="other") for q in QUESTIONS]}
    first = commit_unit(run, "u1", ROWS, epoch=1).manifest
    assert discard_unit(run, "u1", generation=0, epoch=2, reason="asked again")
    assert not discard_unit(run, "u1", generation=0, epoch=3), "somebody had before"
    assert committed_units(run) == ()
    with pytest.raises(InputError, match="expected a committed unit"):
        load_manifest(run, "u1")
    record = json.loads((tmp_path / "discarded" / "u1.json").read_text())
    assert (record["reason"], record["epoch"]) == ("asked again", 2)
    assert first.parts["answers"].path in record["manifest"]
    again = commit_unit(run, "u1", other, epoch=2)
    assert again.won
    assert (again.manifest.generation, load_manifest(run, "u1")) == (1, again.manifest)
    assert read_part(run, first, "answers").num_rows == 3, "evidence"


def test_late_discard_leaves_the_commit_made_since(tmp_path: Path) -> None:
    run = str(tmp_path)
    seen = commit_unit(run, "u1", ROWS).manifest
    discard_unit(run, "u1", generation=seen.generation)
    redone = commit_unit(run, "u1", ROWS).manifest
    assert not discard_unit(run, "u1", generation=seen.generation, reason="late")
    assert load_manifest(run, "u1") == redone
    assert discard_unit(run, "u1"), "without a generation: the one that counts"
    assert committed_units(run) == ()


def test_everything_damaged_is_found_and_can_be_done_again(tmp_path: Path) -> None:
    run = str(tmp_path)
    for name in ("u1", "u2", "u3"):
        commit_unit(run, name, ROWS)
    Path(manifest_uri(run, "u1")).write_text("{")
    (tmp_path / load_manifest(run, "u3").parts["arms"].path).write_bytes(b"")
    found = list(damaged_units(run))
    assert [(damaged.unit, damaged.generation) for damaged in found] == [("u1", 0), ("u3", 0)]
    for damaged in found:
        discard_unit(run, damaged.unit, generation=damaged.generation, reason=damaged.message)
        assert commit_unit(run, damaged.unit, ROWS).won
    assert not list(damaged_units(run))
    assert [m.generation for m in all_manifests(run)] == [1, 0, 1]


def test_every_flipped_bit_of_a_manifest_is_noticed(tmp_path: Path) -> None:
    run = str(tmp_path)
    manifest = commit_unit(run, "u1", ROWS).manifest
    file = Path(manifest_uri(run, "u1"))
    data = file.read_bytes()
    for place in range(0, len(data) * 8, 7):
        flipped = bytearray(data)
        flipped[place // 8] ^= 1 << place % 8
        file.write_bytes(bytes(flipped))
        with contextlib.suppress(InputError):
            assert load_manifest(run, "u1") == manifest, "at most white space has changed"


def test_manifest_of_the_first_layout_is_read(tmp_path: Path) -> None:
    run = str(tmp_path)
    commit_unit(run, "u1", ROWS)
    file = Path(manifest_uri(run, "u1"))
    content = json.loads(file.read_text())
    for name in ("sha256", "epoch", "generation"):
        del content[name]
    file.write_text(json.dumps({**content, "format": 1}))
    assert damage(run, "u1") == ""


@pytest.mark.parametrize("path", ["../../x.parquet", "arms/../../x.parquet", "answers/u1.parquet", "/arms/x.parquet"])
def test_manifest_that_names_a_file_elsewhere_is_refused(tmp_path: Path, path: str) -> None:
    run = str(tmp_path)
    commit_unit(run, "u1", ROWS)
    file = Path(manifest_uri(run, "u1"))
    content = json.loads(file.read_text())
    content["parts"]["arms"]["path"] = path
    del content["sha256"]
    file.write_bytes(sealed(content))
    with pytest.raises(InputError, match="expected a part in the folder"):
        load_manifest(run, "u1")


@pytest.mark.parametrize("unit", ["../../x", "a/b", "", "x" * 300, "a\0b", "a.b", "é"])
def test_unit_id_that_is_no_plain_name_never_reaches_a_path(tmp_path: Path, unit: str) -> None:
    with pytest.raises(InputError, match="expected letters, digits"):
        commit_unit(str(tmp_path / "run"), unit, ROWS)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize("harm", ["flip", "truncate", "remove", "other rows"])
def test_damaged_part_is_found(tmp_path: Path, harm: str) -> None:
    run = str(tmp_path)
    manifest = commit_unit(run, "u1", ROWS).manifest
    path = tmp_path / manifest.parts["arms"].path
    data = bytearray(path.read_bytes())
    if harm == "flip":
        data[len(data) // 3] ^= 16
        path.write_bytes(bytes(data))
    elif harm == "truncate":
        path.write_bytes(bytes(data[:-20]))
    elif harm == "remove":
        path.unlink()
    else:
        path.write_bytes((tmp_path / manifest.parts["answers"].path).read_bytes())
    assert str(path) in damage(run, "u1")
    with pytest.raises(InputError):
        read_part(run, manifest, "arms")


@pytest.mark.parametrize(
    "change",
    [{"unit": "u2"}, {"format": 3}, {"parts": {"nonsense": {}}}, {"extra": 1}, {"parts": 3}, {"questions": None}],
    ids=str,
)
def test_manifest_that_is_not_one_is_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    run = str(tmp_path)
    commit_unit(run, "u1", ROWS)
    file = Path(manifest_uri(run, "u1"))
    content = {**json.loads(file.read_text()), **change}
    if change == {"questions": None}:
        del content["questions"]
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match="manifests/u1"):
        load_manifest(run, "u1")


def test_manifest_half_written_by_another_tool_is_refused(tmp_path: Path) -> None:
    run = str(tmp_path)
    commit_unit(run, "u1", ROWS)
    file = Path(manifest_uri(run, "u1"))
    file.write_text(file.read_text()[:40])
    with pytest.raises(InputError, match="expected JSON"):
        load_manifest(run, "u1")
    assert "expected JSON" in damage(run, "u1")
