"""ScanRefer: one object of a ScanNet scan for each description, grouped as unique or multiple.

Object ids are the scan's 0-based objectId, written as texts; names have underscores for blanks. A description is
"unique" when its object is the only one of its class among the objects the file refers to in that scene, and
"multiple" otherwise. Classes are the 18 of the benchmark, found through ScanNet's label table; names it does not know
are "others". The grouping depends on the whole file, so a sample of it groups otherwise.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from dataclasses import replace

from pipeline.datasets.json_items import Item, read_items, read_json
from pipeline.scene.questions.names import names
from schemas.errors import InputError
from schemas.questions import Question
from schemas.storage import exists, join, read_bytes

SUBSETS = ("all", "unique", "multiple")
LABELS_FILE = "scannetv2-labels.combined.tsv"
"""ScanNet's label table; the grouping needs it."""
OBJECTS_FILE = "objects_info_val.json"
"""Names of objects by scene, for question files that have none."""
CLASSES = names(
    "cabinet, bed, chair, sofa, table, door, window, bookshelf, picture, counter, desk, curtain, refrigerator, "
    "shower curtain, toilet, sink, bathtub"
)
"""The benchmark's classes but the eighteenth, others."""
OTHERS = "others"
_MISSPELT = {"refridgerator": "refrigerator"}
"""As some releases of the table have it."""


def load_scanrefer(
    path: str, subset: str = "all", labels: str | None = None, objects: str | None = None
) -> tuple[Question, ...]:
    """Return ScanRefer's questions, in file order.

    Two layouts are read: the official one (scene_id, object_id, object_name, ann_id, description) and one with
    scan_id, target_id and caption, whose ids count the captions of an object.

    Args:
        path: ScanRefer_filtered_val.json.
        subset: One of `SUBSETS`, as `load_dataset_questions` checks; unique and
            multiple need the label table.
        labels: ScanNet's label table; None looks beside the question file. Without it `category` is empty.
        objects: A JSON object of scene to [{id, label}], for the layout without names; None looks beside the question
            file.

    Raises:
        InputError: A file is wrong, a question repeats, or a subset is asked for that cannot be told.
    """
    items = read_items(path)
    if "scan_id" in items[0].fields:
        questions = _captions(items, _object_names(objects or _beside(path, OBJECTS_FILE)))
    else:
        questions = tuple(_official(item) for item in items)
    repeated = [name for name, count in Counter(q.question_id for q in questions).items() if count > 1]
    if repeated:
        found = f"{repeated[0]} twice"
        raise InputError(path, field="ann_id", expected="each scene, object and ann_id once", found=found)
    table = labels or _beside(path, LABELS_FILE)
    if table is not None:
        questions = _grouped(questions, read_label_classes(table))
    elif subset != "all":
        expected = f"{LABELS_FILE} of ScanNet, to tell {subset} from the rest"
        raise InputError("scanrefer", field="labels", expected=expected, found="none given and none beside the file")
    return tuple(q for q in questions if subset in ("all", q.category))


def read_label_classes(uri: str) -> dict[str, str]:
    """Return the benchmark class of each raw label in ScanNet's label table.

    Raises:
        InputError: The file is missing or has not the columns raw_category and nyu40class.
    """
    try:
        rows = list(csv.DictReader(io.StringIO(read_bytes(uri).decode("utf-8")), delimiter="\t"))
        nyu = {row["raw_category"]: row["nyu40class"] for row in rows}
    except (UnicodeDecodeError, KeyError, csv.Error) as error:
        expected = "a table with tabs and the columns raw_category and nyu40class"
        raise InputError(uri, expected=expected, found=error) from error
    spelt = {raw: _MISSPELT.get(name, name) for raw, name in nyu.items()}
    return {raw: name if name in CLASSES else OTHERS for raw, name in spelt.items()}


def _official(item: Item) -> Question:
    scene, target = item.text("scene_id"), item.integer("object_id")
    return _question(
        f"{scene}-{target}-{item.integer('ann_id')}", scene, item.text("description"), target, item.text("object_name")
    )


def _captions(items: tuple[Item, ...], labels: dict[tuple[str, int], str]) -> tuple[Question, ...]:
    counts: Counter[tuple[str, int]] = Counter()
    questions = []
    for item in items:
        scene, target = item.text("scan_id"), item.integer("target_id")
        number = counts[scene, target]
        counts[scene, target] += 1
        question_id = f"{scene}-{target}-{number}"
        questions.append(_question(question_id, scene, item.text("caption"), target, labels.get((scene, target), "")))
    return tuple(questions)


def _question(question_id: str, scene: str, text: str, target: int, name: str) -> Question:
    category = name.replace("_", " ")
    return Question(question_id, scene, "ground_one", text, target_ids=(target,), target_category=category)


def _grouped(questions: tuple[Question, ...], classes: dict[str, str]) -> tuple[Question, ...]:
    objects = {(q.scene, q.target_ids): classes.get(q.target_category, OTHERS) for q in questions if q.target_category}
    alike = Counter((scene, name) for (scene, _), name in objects.items())
    return tuple(
        replace(q, category="unique" if alike[q.scene, classes.get(q.target_category, OTHERS)] == 1 else "multiple")
        if q.target_category
        else q
        for q in questions
    )


def _object_names(uri: str | None) -> dict[tuple[str, int], str]:
    if uri is None:
        return {}
    document = read_json(uri)
    if not isinstance(document, dict) or not all(isinstance(entries, list) for entries in document.values()):
        raise InputError(uri, expected="a JSON object of scene to a list of objects", found=type(document).__name__)
    labels = {}
    for scene, entries in document.items():
        for i, entry in enumerate(entries):
            item = Item(f"{uri} {scene} object {i}", entry if isinstance(entry, dict) else {})
            labels[scene, item.integer("id")] = item.text("label")
    return labels


def _beside(path: str, name: str) -> str | None:
    at = join(path.rsplit("/", 1)[0] if "/" in path else ".", name)
    return at if exists(at) else None
