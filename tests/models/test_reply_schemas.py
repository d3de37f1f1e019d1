"""Reply schemas: whatever a schema admits, the stage's parser reads; whatever the parser refuses, no schema admits."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.models import replies, reply_schemas
from pipeline.models.messages import ImagePart, Message, Request, Stage
from pipeline.models.reply_schemas import reply_schema, schema_note

IMAGE = ImagePart(np.zeros((1, 1, 3), np.uint8))
NAMES = ("coat rack", "sofa", "TV", "<b>", "1. shelf")
FORMED: tuple[Stage, ...] = ("evidence", "choice", "verify", "answer_one", "answer_many", "judge")
STRICT = {"type", "properties", "required", "additionalProperties", "items", "enum"}
"""Keywords that every server's strict mode knows."""


def _request(stage: Stage, count: int, *, images: bool = False) -> Request:
    shown = images or stage in ("answer_one", "answer_many", "view_answer", "caption")
    variables: dict[str, Any] = {"question": "Q", "categories": list(NAMES), "k": count}
    variables["candidates"] = ["a"] * count
    return Request(stage, (Message("user", (IMAGE,) * count if shown else ("Q",)),), variables)


def _read(stage: Stage, text: str, count: int) -> Any:
    match stage:
        case "evidence":
            return replies.parse_evidence(text, NAMES, count)
        case "choice" | "verify":
            return replies.parse_index(text, count)
        case "answer_one":
            return replies.parse_image_answer(text, count)
        case "answer_many":
            return replies.parse_yes_no(text, count)
    return replies.parse_mark(text)


def _admitted(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    match schema["type"]:
        case "object":
            return st.fixed_dictionaries({name: _admitted(part) for name, part in schema["properties"].items()})
        case "array":
            return st.lists(_admitted(schema["items"]), max_size=6)
    return st.text(min_size=1).filter(str.strip)


def _parts(schema: Any) -> list[dict[str, Any]]:
    if not isinstance(schema, dict):
        return []
    inner = [*schema.get("properties", {}).values(), schema.get("items")]
    return [schema, *(found for part in inner for found in _parts(part))]


@pytest.mark.parametrize("stage", FORMED)
@settings(deadline=None)
@given(data=st.data(), count=st.integers(1, 12))
def test_every_admitted_reply_is_read_as_it_says(stage: Stage, data: st.DataObject, count: int) -> None:
    schema = reply_schema(_request(stage, count))
    assert schema is not None
    value = data.draw(_admitted(schema))
    text = json.dumps(value, ensure_ascii=data.draw(st.booleans()), indent=data.draw(st.sampled_from([None, 1])))
    reading = _read(stage, text, count)
    match stage:
        case "evidence":
            assert reading == tuple(dict.fromkeys(value["categories"]))[:count]
        case "answer_one":
            assert (reading.index, reading.answer) == (value["image"], value["answer"].strip())
        case "answer_many":
            assert reading == tuple(value[f"Image {index}"] == "Yes" for index in range(count))
        case _:
            assert [reading] == list(value.values())


@pytest.mark.parametrize("stage", FORMED)
def test_schemas_keep_to_what_strict_servers_take(stage: Stage) -> None:
    schema = reply_schema(_request(stage, 3))
    assert schema is not None
    assert schema["type"] == "object"
    for part in _parts(schema):
        assert set(part) <= STRICT
        if part["type"] == "object":
            assert part["additionalProperties"] is False
            assert part["required"] == list(part["properties"])


def test_choice_by_images_counts_the_images() -> None:
    schema = reply_schema(_request("choice", 4, images=True))
    assert schema is not None
    assert schema["properties"]["index"]["enum"] == [0, 1, 2, 3]


@pytest.mark.parametrize("stage", ["view_answer", "caption"])
def test_free_text_has_no_schema_and_no_note(stage: Stage) -> None:
    assert reply_schema(_request(stage, 1)) is None
    assert schema_note(_request(stage, 1)) == ""


@pytest.mark.parametrize("stage", FORMED)
def test_note_speaks_of_json_and_names_the_fields(stage: Stage) -> None:
    request = _request(stage, 2)
    note, schema = schema_note(request), reply_schema(request)
    assert "JSON" in note
    assert schema is not None
    assert all(f'"{field}"' in note for field in schema["properties"])


def test_a_vocabulary_too_long_for_an_enumeration_is_left_to_the_parser() -> None:
    names = [f"thing {i}" for i in range(reply_schemas.MOST_NAMES + 1)]
    request = Request("evidence", (), {"question": "Q", "categories": names, "k": 3})
    assert reply_schema(request)["properties"]["categories"]["items"] == {"type": "string"}  # type: ignore[index]
