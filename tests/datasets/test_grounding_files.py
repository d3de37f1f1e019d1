"""ScanRefer, Multi3DRefer and referring segmentation files."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from pipeline.datasets import load_dataset_questions
from pipeline.datasets.scanrefer import read_label_classes
from schemas.errors import InputError

LABELS = (
    "id\traw_category\tnyu40class\n1\tchair\tchair\n2\toffice chair\tchair\n3\tfridge\trefridgerator\n4\tlamp\tlamp\n"
)


def scanrefer_item(
    object_id: Any = "3", name: str = "office_chair", ann_id: Any = "0", scene: str = "scene0000_00"
) -> Any:
    item = {"scene_id": scene, "object_id": object_id, "object_name": name, "ann_id": ann_id}
    return {**item, "description": "a chair by the desk.", "token": ["a"]}


def write(folder: Path, items: Any, name: str = "ScanRefer_filtered_val.json") -> str:
    (folder / name).write_text(json.dumps(items))
    return str(folder / name)


def test_sampled_official_file_loads_whole(shared_data: Path) -> None:
    path = str(shared_data / "scanrefer/ScanRefer_filtered_val_sampled1000.json")
    questions = load_dataset_questions("scanrefer", path)
    assert len(questions) == 1000
    assert {q.task for q in questions} == {"ground_one"}
    assert all(q.target_ids is not None and len(q.target_ids) == 1 for q in questions)
    assert not [q for q in questions if "_" in q.target_category]
    assert Counter(q.category for q in questions) == {"multiple": 654, "unique": 346}
    assert len({q.scene for q in questions}) == 138
    assert len(load_dataset_questions("scanrefer", path, "unique")) == 346
    assert len(load_dataset_questions("scanrefer", path, "multiple")) == 654


def test_all_validation_queries_load_and_group(shared_data: Path) -> None:
    path = str(shared_data / "scanrefer/scanrefer_val.json")
    questions = load_dataset_questions("scanrefer", path)
    assert len(questions) == 9498
    assert len({q.scene for q in questions}) == 141
    # The benchmark's own figures are 1,845 and 7,663 of 9,508.
    assert Counter(q.category for q in questions) == {"multiple": 7654, "unique": 1844}


def test_official_ids_name_objects_of_the_scan(shared_data: Path) -> None:
    folder = shared_data / "scanrefer"
    objects = json.loads((folder / "objects_info_val.json").read_text())
    names = {(scene, o["id"]): o["label"] for scene, entries in objects.items() for o in entries}
    for q in load_dataset_questions("scanrefer", str(folder / "ScanRefer_filtered_val_sampled1000.json")):
        assert q.target_ids is not None
        assert names[q.scene, q.target_ids[0]] == q.target_category


def test_unique_is_the_only_object_of_its_class_that_is_referred_to(tmp_path: Path) -> None:
    items = [
        scanrefer_item("3", "office_chair", "0"),
        scanrefer_item("3", "office_chair", "1"),
        scanrefer_item("5", "fridge"),
        scanrefer_item("6", "lamp"),
        scanrefer_item("7", "thing_nobody_knows"),
        scanrefer_item("3", "office_chair", scene="scene0001_00"),
        scanrefer_item("4", "chair", scene="scene0001_00"),
    ]
    (tmp_path / "scannetv2-labels.combined.tsv").write_text(LABELS)
    questions = load_dataset_questions("scanrefer", write(tmp_path, items))
    # A lamp and an unknown thing are both "others"; an office chair and a chair are both chairs.
    expected = ["unique", "unique", "unique", "multiple", "multiple", "multiple", "multiple"]
    assert [q.category for q in questions] == expected
    assert [q.question_id for q in questions[:2]] == ["scene0000_00-3-0", "scene0000_00-3-1"]
    assert questions[0].target_category == "office chair"


def test_label_table_gives_the_benchmark_classes(shared_data: Path) -> None:
    classes = read_label_classes(str(shared_data / "scanrefer/scannetv2-labels.combined.tsv"))
    assert len(set(classes.values())) == 18
    assert (classes["office chair"], classes["couch"], classes["lamp"]) == ("chair", "sofa", "others")


def test_misspelt_refrigerators_are_refrigerators(tmp_path: Path) -> None:
    (tmp_path / "t.tsv").write_text(LABELS)
    assert read_label_classes(str(tmp_path / "t.tsv"))["fridge"] == "refrigerator"
    (tmp_path / "u.tsv").write_text("a\tb\n1\t2\n")
    with pytest.raises(InputError, match="raw_category and nyu40class"):
        read_label_classes(str(tmp_path / "u.tsv"))


def test_without_the_label_table_there_are_no_groups_and_no_subsets(tmp_path: Path) -> None:
    path = write(tmp_path, [scanrefer_item()])
    assert load_dataset_questions("scanrefer", path)[0].category == ""
    with pytest.raises(
        InputError, match=r"labels: expected scannetv2-labels\.combined\.tsv of ScanNet, to tell unique"
    ):
        load_dataset_questions("scanrefer", path, "unique")


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (scanrefer_item("x"), 'item 0: object_id: expected a whole number from 0 up, found "x"'),
        (scanrefer_item(-1), "item 0: object_id"),
        (scanrefer_item(True), "item 0: object_id"),
        (scanrefer_item(ann_id=None), "item 0: ann_id"),
        (scanrefer_item(name=" "), "item 0: object_name"),
        ({"scene_id": "s"}, "item 0: object_id: .* found no such field"),
    ],
)
def test_a_wrong_scanrefer_field_is_named(tmp_path: Path, item: Any, message: str) -> None:
    with pytest.raises(InputError, match=rf"val\.json {message}"):
        load_dataset_questions("scanrefer", write(tmp_path, [item]))


def test_a_repeated_scanrefer_question_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="scene0000_00-3-0 twice"):
        load_dataset_questions("scanrefer", write(tmp_path, [scanrefer_item(), scanrefer_item()]))


def multi(kind: str, ids: Any, ann_id: int = 0) -> Any:
    item = {"scene_id": "scene0011_00", "object_ids": ids, "object_name": "trash_can", "ann_id": ann_id}
    return {**item, "eval_type": kind, "description": "the cans"}


def test_multi3drefer_items_become_many_target_questions(tmp_path: Path) -> None:
    items = [multi("zt_w_d", [], 0), multi("zt_wo_d", [], 1), multi("st_w_d", [4], 2), multi("mt", [4, 9], 3)]
    path = write(tmp_path, [*items, multi("st_wo_d", [0], 4)], "multi3drefer_val.json")
    questions = load_dataset_questions("multi3drefer", path)
    assert [q.target_ids for q in questions] == [(), (), (4,), (4, 9), (0,)]
    assert {q.task for q in questions} == {"ground_many"}
    assert questions[3].category == "mt"
    assert questions[3].question_id == "scene0011_00-3"
    assert questions[3].target_category == "trash can"
    counts = {s: len(load_dataset_questions("multi3drefer", path, s)) for s in ("zt", "st", "mt", "zt_w_d")}
    assert counts == {"zt": 2, "st": 2, "mt": 1, "zt_w_d": 1}


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (multi("st_w_d", []), "expected 1 targets for st_w_d"),
        (multi("mt", [1]), "expected 2 targets or more for mt"),
        (multi("zt_w_d", [1]), "expected 0 targets"),
        (multi("mt", [1, 1]), "each number once"),
        (multi("mt", ["1", "2"]), "a list of whole numbers"),
        (multi("several", [1]), "eval_type: expected one of zt_w_d"),
    ],
)
def test_a_wrong_multi3drefer_item_is_named(tmp_path: Path, item: Any, message: str) -> None:
    with pytest.raises(InputError, match=rf"item 0: .*{message}"):
        load_dataset_questions("multi3drefer", write(tmp_path, [item]))


def test_a_repeated_multi3drefer_question_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="scene0011_00-0 twice"):
        load_dataset_questions("multi3drefer", write(tmp_path, [multi("mt", [1, 2]), multi("st_w_d", [1])]))


def lines(folder: Path, *records: Any) -> str:
    path = folder / "referring.jsonl"
    path.write_text("\n".join(r if isinstance(r, str) else json.dumps(r) for r in records) + "\n")
    return str(path)


def test_referring_lines_get_ids_tasks_and_a_category(tmp_path: Path) -> None:
    one = {"scene": "a", "question": "Which chair is red?", "target_ids": [3]}
    two = {"scene": "a", "question": "Which chairs are blue?", "target_ids": [4, 5], "question_id": "mine"}
    path = lines(tmp_path, one, "", two, {**one, "scene": "b", "target_category": "chair"})
    questions = load_dataset_questions("referring", path)
    assert [q.question_id for q in questions] == ["a-referring-000", "mine", "b-referring-000"]
    assert [q.task for q in questions] == ["ground_one", "ground_many", "ground_one"]
    assert {q.category for q in questions} == {"referring"}
    assert questions[2].target_category == "chair"


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({"scene": "a", "question": "Which?"}, "target_ids: .* found no such field"),
        ({"scene": "a", "question": "Which?", "target_ids": []}, "at least one instance id"),
        (
            {"scene": "a", "question": "Which?", "target_ids": [1], "targets": [1]},
            "targets: expected one of the fields",
        ),
        ({"scene": "a", "question": "Which?", "target_ids": [1], "task": "eqa"}, "task: expected one of ground_one"),
        ("{", "a JSON object on one line"),
        ("[1]", "a JSON object"),
    ],
)
def test_a_wrong_referring_line_is_named(tmp_path: Path, record: Any, message: str) -> None:
    good = {"scene": "a", "question": "Which?", "target_ids": [1]}
    with pytest.raises(InputError, match=rf"line 2:.*{message}"):
        load_dataset_questions("referring", lines(tmp_path, good, record))


def test_repeated_ids_and_empty_referring_files_are_refused(tmp_path: Path) -> None:
    record = {"scene": "a", "question": "Which?", "target_ids": [1], "question_id": "x"}
    with pytest.raises(InputError, match="line 2: question_id: expected an id no other line has, found x"):
        load_dataset_questions("referring", lines(tmp_path, record, record))
    with pytest.raises(InputError, match="an empty file"):
        load_dataset_questions("referring", lines(tmp_path, ""))
