from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from schemas import compaction, storage
from schemas.compaction import Compactor, blocks_of, compact
from schemas.errors import InputError
from schemas.manifest import all_manifests, commit_unit, committed_units, damaged_units, discard_unit, load_manifest
from schemas.plan import PLAN_FILE, encode_plan
from schemas.run_folder import RunFolder, read_table
from tests.workers.fake_steps import answer, arm, unit

UNITS = [unit(index, ["a", "b"]) for index in range(6)]
SIZES = [(u.id, 2) for u in UNITS]


def rows(index: int, **changes: Any) -> dict[str, list[Any]]:
    questions = UNITS[index].questions
    arms = [arm(question, name) for question in questions for name in ("initial", "final")[: 1 + index % 2]]
    return {"answers": [answer(question, **changes) for question in questions], "arms": arms}


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A run of six units of two questions, in blocks of two units; five are committed, nothing is merged."""
    monkeypatch.setattr(compaction, "BLOCK_QUESTIONS", 4)
    folder = RunFolder(str(tmp_path))
    storage.write_bytes_atomic(folder.uri(PLAN_FILE), encode_plan(UNITS))
    folder.write_run({"name": "test"})
    for index in (4, 0, 3, 1, 2):
        commit_unit(folder.root, UNITS[index].id, rows(index), epoch=index)
    return folder.root


def files(run: str) -> list[str]:
    return [name for name in storage.list_files(run, recursive=True) if name not in ("run.json", PLAN_FILE)]


def test_full_blocks_are_merged_and_every_row_stays(run: str) -> None:
    before = {name: read_table(run, name) for name in ("answers", "arms", "regions")}
    manifests = list(all_manifests(run))
    Compactor(run, SIZES)
    assert len(files(run)) == 2 * 3 + 3, "two blocks of two parts and a manifest, and the unit that waits for another"
    for name, table in before.items():
        assert read_table(run, name).equals(table)
    assert committed_units(run) == tuple(sorted(u.id for u in UNITS[:5]))
    for old, new in zip(manifests, all_manifests(run), strict=True):
        assert (old.unit, old.questions, old.statuses, old.epoch) == (new.unit, new.questions, new.statuses, new.epoch)
        assert {name: entry.rows for name, entry in old.parts.items()} == {n: e.rows for n, e in new.parts.items()}
    assert not list(damaged_units(run))


def test_last_commit_of_a_block_merges_it(run: str) -> None:
    compactor = Compactor(run, SIZES)
    commit_unit(run, UNITS[5].id, rows(5))
    assert compactor.committed(UNITS[5].id)
    assert not compactor.committed(UNITS[5].id)
    assert len(files(run)) == 9


def test_late_commit_of_a_merged_unit_never_counts(run: str) -> None:
    Compactor(run, SIZES)
    commit_unit(run, UNITS[0].id, rows(0, answer="late"))
    assert set(read_table(run, "answers")["answer"]) == {""}
    Compactor(run, SIZES)
    assert len(files(run)) == 9, "and is cleared away"


def test_unit_of_a_block_is_taken_back_alone_and_merged_again(run: str) -> None:
    Compactor(run, SIZES)
    assert discard_unit(run, UNITS[1].id, generation=load_manifest(run, UNITS[1].id).generation)
    assert UNITS[1].id not in committed_units(run)
    assert len(read_table(run, "answers")) == 8
    compactor = Compactor(run, SIZES)
    assert commit_unit(run, UNITS[1].id, rows(1, answer="again")).manifest.generation == 1
    assert compactor.committed(UNITS[1].id)
    assert list(read_table(run, "answers")["answer"]) == ["", "", "again", "again", *[""] * 6]
    assert len(files(run)) == 9 + 1, "and the record of the commit taken back"


def test_damaged_part_is_never_merged(run: str) -> None:
    path = Path(run, load_manifest(run, UNITS[0].id).parts["arms"].path)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(InputError, match=path.name):
        compact(run, [UNITS[0].id, UNITS[1].id])
    with pytest.raises(InputError, match="expected a committed unit"):
        compact(run, [UNITS[4].id, UNITS[5].id])
    assert not Path(run, "blocks").exists()


def test_reader_that_looked_before_a_merge_reads_on(run: str) -> None:
    expected, parts = read_table(run, "answers")["question_id"].tolist(), RunFolder(run).parts("answers")
    first = next(parts)
    Compactor(run, SIZES)
    found = [name for table in (first, *parts) for name in table.column("question_id").to_pylist()]
    assert found == expected
    manifests = RunFolder(run).manifests()
    assert next(manifests).unit == UNITS[0].id


def test_a_million_questions_have_a_bounded_number_of_files() -> None:
    tables, chunk = 8, 25
    blocks = list(blocks_of((str(index), chunk) for index in range(1_000_000 // chunk)))
    largest = max(map(len, blocks))
    open_blocks = 2
    assert len(blocks) * (tables + 1) + open_blocks * largest * (tables + 1) < 10_000


def test_blocks_are_consecutive_and_the_rest_waits() -> None:
    sizes = [(str(index), 2_500) for index in range(8)]
    assert list(blocks_of(sizes)) == [("0", "1", "2"), ("3", "4", "5")]
