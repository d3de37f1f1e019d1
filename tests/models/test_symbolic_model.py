"""The symbolic model as a chat client: replies that parse, the same every time, from the view and nothing else."""

from __future__ import annotations

import ast
import asyncio
import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.models.messages import ChatClient, ImagePart, Message, Observation, Request, Stage
from pipeline.models.prompts import Prompts
from pipeline.models.replies import (
    parse_evidence,
    parse_image_answer,
    parse_index,
    parse_mark,
    parse_text,
    parse_yes_no,
)
from pipeline.models.symbolic import SymbolicModel
from pipeline.models.symbolic.perceive import perceive
from pipeline.models.symbolic.sight import content_key
from pipeline.models.symbolic.view import View
from schemas.errors import InputError
from tests.models.symbolic_painting import HEIGHT, WIDTH, Box, paint, room

SOURCES = Path(__file__).parents[2] / "pipeline" / "models" / "symbolic"
CHAIR = Box("chair", (0, 3.0), (0.5, 0.8, 0.5), color="red")


def reply(
    stage: Stage, images: tuple[ImagePart, ...] = (), model: SymbolicModel | None = None, **variables: Any
) -> str:
    request = Request(stage, (Message("user", images),), variables)
    return asyncio.run((model or SymbolicModel()).complete(request)).text


@pytest.fixture(scope="module")
def image() -> ImagePart:
    return paint(room(CHAIR))


def test_symbolic_model_is_a_chat_client_that_says_what_it_is() -> None:
    model: ChatClient = SymbolicModel()

    assert model.name == "symbolic"
    assert model.identity() == {"kind": "symbolic", "rules": model.identity()["rules"]}
    assert model.identity()["rules"]


def test_every_stage_replies_in_the_form_its_parser_reads(image: ImagePart) -> None:
    question, candidates = "What color is the chair?", ["I cannot tell from this view.", "The chair is red."]

    names = ["bed", "chair"]
    assert parse_evidence(reply("evidence", question=question, categories=names, k=3), names, 3) == ("chair",)
    assert parse_evidence(reply("evidence", question="the unicorn", categories=names, k=1), names, 1) == ()
    assert parse_text(reply("view_answer", (image,), question=question)) == "The chair is red."
    assert parse_index(reply("choice", question=question, candidates=candidates), 2) == 1
    assert parse_index(reply("verify", question=question, candidates=candidates), 2) == 1
    answer = parse_image_answer(reply("answer_one", (paint(room()), image), question=question), 2)
    assert answer is not None
    assert (answer.index, answer.answer) == (1, "The chair is red.")
    assert parse_yes_no(reply("answer_many", (paint(room()), image), question="the red chairs"), 2) == (False, True)
    mark = reply("judge", question=question, answer="Red", prediction="The chair is red.", extra_answers=[])
    assert parse_mark(mark) == 5


def test_replies_do_not_depend_on_the_wording_of_the_prompt(image: ImagePart) -> None:
    variables: dict[str, Any] = {"question": "What color is the chair?"}
    filled = Prompts.load().fill("view_answer", variables, (image,))

    assert asyncio.run(SymbolicModel().complete(filled)).text == reply("view_answer", (image,), **variables)


def test_the_same_view_gives_the_same_reply_whatever_was_seen_before(image: ImagePart) -> None:
    other = paint(room(Box("chair", (0.6, 3.5), (0.5, 0.8, 0.5), color="blue")))
    model = SymbolicModel(kept_views=1)
    question = "What color is the chair?"

    first = reply("view_answer", (image,), model, question=question)
    between = reply("view_answer", (other,), model, question=question)
    again = reply("view_answer", (image,), model, question=question)

    assert first == again == reply("view_answer", (image,), question=question)
    assert between != first


def test_views_are_perceived_once_and_the_oldest_are_dropped(image: ImagePart, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[ImagePart] = []

    def look(part: ImagePart) -> View:
        seen.append(part)
        return perceive(part)

    monkeypatch.setattr("pipeline.models.symbolic.sight.perceive", look)
    model = SymbolicModel(kept_views=2)
    others = [paint(room(dataclasses.replace(CHAIR, at=(x, 3.0)))) for x in (-0.5, 0.5)]

    for part in (image, image, others[0], image, others[1], image, others[0]):
        reply("view_answer", (part,), model, question="Is there a chair?")

    assert [id(part) for part in seen] == [id(part) for part in (image, others[0], others[1], others[0])]
    assert (model.sight.perceived, model.sight.recalled) == (4, 3)


def test_an_image_that_was_looked_at_can_no_longer_change(image: ImagePart) -> None:
    seen = image.observation
    assert seen is not None
    backing = np.stack([image.color, image.color])
    part = ImagePart(backing[0], dataclasses.replace(seen, depth=seen.depth.copy()))
    model, question = SymbolicModel(), "What color is the chair?"
    assert reply("view_answer", (part,), model, question=question) == "The chair is red."

    assert part.observation is not None
    for array in (part.color, part.observation.depth, part.observation.category):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    backing[...] = 0  # a view of memory that belongs to another was copied
    assert reply("view_answer", (part,), model, question=question) == "The chair is red."
    assert reply("view_answer", (ImagePart(backing[0], seen),), model, question=question) != "The chair is red."


def test_content_key_tells_apart_whatever_is_seen(image: ImagePart) -> None:
    seen = image.observation
    assert seen is not None
    swapped = image.color.copy()
    swapped[0, 0], swapped[-1, -1] = swapped[-1, -1] ^ 128, swapped[0, 0] ^ 128
    depth, category = seen.depth.copy(), seen.category.copy()
    depth[-1, -1] = np.nextafter(depth[-1, -1], np.float32(np.inf))
    category[0, 0] ^= 1
    different = [
        ImagePart(swapped, seen),
        ImagePart(image.color, dataclasses.replace(seen, depth=depth)),
        ImagePart(image.color, dataclasses.replace(seen, category=category)),
        ImagePart(image.color, dataclasses.replace(seen, K=seen.K * 1.5)),
        ImagePart(image.color, dataclasses.replace(seen, up=-seen.up)),
        ImagePart(image.color, dataclasses.replace(seen, vocabulary=seen.vocabulary[:-1])),
        ImagePart(image.color.reshape(WIDTH, HEIGHT, 3), seen),
        image,
    ]
    copied = ImagePart(image.color.copy(), dataclasses.replace(seen, depth=seen.depth.copy()))

    assert len({content_key(part) for part in different}) == len(different)
    assert content_key(copied) == content_key(image)


def test_colours_alone_are_not_enough(image: ImagePart) -> None:
    blind = dataclasses.replace(image, observation=None)

    assert reply("view_answer", (blind,), question="What color is the chair?") == "I cannot tell from this view."


def test_moving_the_world_does_not_change_an_answer(image: ImagePart) -> None:
    """An observation holds no world position: the same picture from elsewhere is the same picture."""
    assert {field.name for field in dataclasses.fields(Observation)} == {"category", "depth", "K", "up", "vocabulary"}
    shown = {field.name for field in dataclasses.fields(ImagePart) if field.init}
    assert shown == {"color", "observation"}


def test_the_rules_import_nothing_that_knows_the_truth() -> None:
    allowed: tuple[str, ...] = (
        "pipeline.models.",
        "pipeline.scene.color_names",
        "pipeline.cached_kernels",
        "schemas.errors",
        "numpy",
    )
    allowed += ("numba", "jaxtyping")
    standard = ("__future__", "collections", "dataclasses", "enum", "functools", "math", "re", "typing")
    for path in SOURCES.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                assert name.startswith(allowed) or name.split(".")[0] in standard, f"{path.name} imports {name}"


@pytest.mark.parametrize(
    ("stage", "variables"),
    [
        ("view_answer", {}),
        ("view_answer", {"question": "What is it?"}),
        ("evidence", {"question": "What is it?", "k": 3}),
        ("choice", {"question": "What is it?", "candidates": []}),
        ("dream", {"question": "What is it?"}),
    ],
)
def test_a_request_that_lacks_something_is_refused(stage: Any, variables: dict[str, Any]) -> None:
    request = object.__new__(Request)
    for name, value in (("stage", stage), ("messages", ()), ("variables", variables)):
        object.__setattr__(request, name, value)

    with pytest.raises(InputError, match="symbolic model"):
        asyncio.run(SymbolicModel().complete(request))


def test_perceiving_noise_is_quiet_and_quick() -> None:
    rng = np.random.default_rng(0)
    noise = Observation(
        rng.integers(-1, 20, (240, 320)).astype(np.int32),
        rng.random((240, 320)).astype(np.float32) * 5,
        np.diag([280.0, 280.0, 1.0]),
        np.array([0.0, -1.0, 0.0]),
        tuple(f"thing {i}" for i in range(20)),
    )
    part = ImagePart(rng.integers(0, 256, (240, 320, 3)).astype(np.uint8), noise)

    started = time.perf_counter()
    assert reply("view_answer", (part,), question="How many things are there?")
    # 0.1 s when alone; the bound only catches a pairwise loop over ten thousand specks.
    assert time.perf_counter() - started < 5.0
