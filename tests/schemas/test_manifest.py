from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from schemas import storage
from schemas.errors import InputError
from schemas.manifest import commit_unit, committed_units, damage, load_manifest, manifest_uri, read_part
from tests.workers.fake_steps import answer, arm, unit

QUESTIONS = unit(0, ["a", "b", "c"]).questions
ROWS: dict[str, list[Any]] = {
    "answers": [answer(q, status=s) for q, s in zip(QUESTIONS, ("answered", "failed", "answered"), strict=True)],
    "arms": [arm(q, "final") for q in QUESTIONS],
    "regions": [],
}


def test_committed_unit_reads_back_verified(tmp_path: Path) -> None:
    run = str(tmp_path)
    manifest = commit_unit(run, "u1", ROWS)
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


def test_second_attempt_with_other_rows_leaves_no_mixture(tmp_path: Path) -> None:
    run = str(tmp_path)
    first = commit_unit(run, "u1", ROWS)
    second = commit_unit(run, "u1", {"answers": [answer(q, answer="other") for q in QUESTIONS]})
    assert first.parts["answers"].path != second.parts["answers"].path
    assert load_manifest(run, "u1") == second
    assert read_part(run, first, "answers").num_rows == 3, "the first attempt's parts are whole as well"


@pytest.mark.parametrize("harm", ["flip", "truncate", "remove", "other rows"])
def test_damaged_part_is_found(tmp_path: Path, harm: str) -> None:
    run = str(tmp_path)
    manifest = commit_unit(run, "u1", ROWS)
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
    [{"unit": "u2"}, {"format": 2}, {"parts": {"nonsense": {}}}, {"extra": 1}, {"parts": 3}, {"questions": None}],
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
    with pytest.raises(InputError, match="expected a manifest"):
        load_manifest(run, "u1")
    assert "expected a manifest" in damage(run, "u1")
