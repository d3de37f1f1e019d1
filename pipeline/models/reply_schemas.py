"""The JSON form of each stage's reply, for servers that hold a model to a schema.

Schemas keep to what OpenAI's strict mode, vLLM, llama.cpp and Ollama all take: one object, every field required, no
further fields, enumerations in place of ranges and lengths. Free text (view answers, captions) has no schema: there is
no form to hold it to, and `json_object` would only wrap it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.models.messages import Message, Request

VERSION = 1
"""Raised when a schema or the note changes: it enters the identity of endpoints that use them."""
MOST_NAMES = 250
"""Longest enumeration sent: OpenAI bounds the total length of larger ones. The parser sees to longer vocabularies."""

_NOTE = "Whatever form was named above, give the reply as one JSON object"


def reply_schema(request: Request) -> dict[str, Any] | None:
    """Return the JSON schema of a request's reply; None where the reply is free text.

    What a schema admits, the stage's parser reads, but for repeated names and names beyond k.
    """
    variables, images = request.variables, len(request.images())
    match request.stage:
        case "evidence":
            names = sorted(set(variables["categories"]))
            name = _one_of(names) if len(names) <= MOST_NAMES else {"type": "string"}
            return _object({"categories": {"type": "array", "items": name}})
        case "choice" | "verify":
            return _object({"index": _index(images or len(variables["candidates"]))})
        case "answer_one":
            return _object({"image": _index(images), "answer": {"type": "string"}})
        case "answer_many":
            return _object({f"Image {index}": _one_of(("Yes", "No")) for index in range(images)})
        case "judge":
            return _object({"mark": {"type": "integer", "enum": [1, 2, 3, 4, 5]}})
    return None


def schema_note(request: Request) -> str:
    """Return what a prompt adds to ask for JSON; empty where the reply is free text.

    The prompts' own words ask for plain text; a model that is held to a schema answers better when it is told, and
    OpenAI refuses `json_object` unless a message speaks of JSON.
    """
    match request.stage:
        case "evidence":
            return f'{_NOTE} {{"categories": [...]}} with the names in a list, empty if none can help.'
        case "choice" | "verify":
            return f'{_NOTE} {{"index": i}}.'
        case "answer_one":
            return f'{_NOTE} {{"image": i, "answer": "..."}}.'
        case "answer_many":
            pairs = {f"Image {index}": "Yes or No" for index in range(len(request.images()))}
            return f"{_NOTE}: {json.dumps(pairs)}."
        case "judge":
            return f'{_NOTE} {{"mark": d}}.'
    return ""


def response_format(request: Request, structured: str) -> dict[str, Any] | None:
    """Return the field `response_format` of a request; None where nothing is asked of the reply's form.

    Args:
        request: The request.
        structured: An endpoint's way: none, json_schema or json_object.
    """
    schema = None if structured == "none" else reply_schema(request)
    if schema is None or structured == "json_object":
        return None if schema is None else {"type": "json_object"}
    return {"type": "json_schema", "json_schema": {"name": request.stage, "strict": True, "schema": schema}}


def messages_sent(request: Request, structured: str) -> tuple[Message, ...]:
    """Return a request's messages as an endpoint gets them: with the note on the reply's form, where it asks for one.

    Args:
        request: The request.
        structured: An endpoint's way: none, json_schema or json_object.
    """
    if structured == "none" or reply_schema(request) is None:
        return request.messages
    *before, asked = request.messages
    return (*before, Message(asked.role, (*asked.parts, f"\n\n{schema_note(request)}")))


def _object(fields: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": dict(fields), "required": list(fields), "additionalProperties": False}


def _index(count: int) -> dict[str, Any]:
    return {"type": "integer", "enum": list(range(count))}


def _one_of(names: Sequence[str]) -> dict[str, Any]:
    return {"type": "string", "enum": list(names)}
