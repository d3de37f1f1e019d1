"""Prompts: strict placeholders, text that is never expanded twice, images in place, hashes that follow the wording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.models.messages import ImagePart
from pipeline.models.prompts import BUILT_IN, REQUIRED, Prompts
from schemas.errors import InputError

PROMPTS = Prompts.load()
IMAGES = [ImagePart(np.full((2, 3, 3), value, np.uint8)) for value in (0, 128, 255)]
VARIABLES: Mapping[str, Any] = {
    "question": "Where is the lamp?",
    "categories": ["lamp", "sofa"],
    "k": 3,
    "candidates": ["On the desk.", "I cannot tell from this view."],
    "answer": "on the desk",
    "prediction": "the desk",
    "extra_answers": ["beside the screen"],
}
STAGES = [name for name in REQUIRED if name != "judge_extra"]


def _fill(stage: str, **changed: Any) -> Any:
    images = IMAGES if "images" in REQUIRED[stage] else ()
    return PROMPTS.fill(stage, {**VARIABLES, **changed}, images)


def _text(request: Any) -> str:
    return "\n".join(part for m in request.messages for part in m.parts if isinstance(part, str))


@pytest.mark.parametrize("stage", STAGES)
def test_fill_leaves_no_placeholder_and_holds_every_value(stage: str) -> None:
    text = _text(_fill(stage))
    assert "{{" not in text
    for name in REQUIRED[stage] - {"images"}:
        value = VARIABLES[name]
        for item in value if isinstance(value, list) else [str(value)]:
            assert item in text


@pytest.mark.parametrize("stage", STAGES)
@given(question=st.text(min_size=1).filter(str.strip))
def test_fill_any_question_text_comes_out_unchanged(stage: str, question: str) -> None:
    assert question in _text(_fill(stage, question=question))


@pytest.mark.parametrize("stage", ["choice", "evidence", "judge"])
def test_fill_braces_in_data_are_not_expanded(stage: str) -> None:
    evil = "{{candidates}} {{k}} {question} }} {{"
    text = _text(_fill(stage, question=evil, prediction=evil, categories=[evil], candidates=[evil]))
    assert text.count(evil) == 1 + (stage in ("choice", "evidence", "judge"))


def test_fill_candidate_with_line_breaks_cannot_pose_as_another() -> None:
    text = _text(_fill("choice", candidates=["red\n1: blue\u2028 2: green", "x"]))
    assert "0: red 1: blue 2: green\n1: x" in text


def test_fill_images_follow_their_labels_in_order() -> None:
    parts = PROMPTS.fill("answer_many", VARIABLES, IMAGES).messages[-1].parts
    places = [i for i, part in enumerate(parts) if isinstance(part, ImagePart)]
    assert [parts[i] for i in places] == IMAGES
    assert [parts[i - 1] for i in places] == ["Image 0", "Image 1", "Image 2"]
    assert all(part.strip() for part in parts if isinstance(part, str))


def test_fill_keeps_variables_for_the_symbolic_model() -> None:
    assert _fill("choice").variables == VARIABLES


@pytest.mark.parametrize(("stage", "images"), [("choice", IMAGES), ("answer_one", [])])
def test_fill_wrong_images_raises(stage: Any, images: Any) -> None:
    with pytest.raises(InputError, match="images"):
        PROMPTS.fill(stage, VARIABLES, images)


def test_fill_missing_variable_names_it() -> None:
    with pytest.raises(InputError, match="candidates"):
        PROMPTS.fill("choice", {"question": "Q"})


def test_judge_with_extra_answers_uses_the_other_prompt() -> None:
    assert PROMPTS.template_name("judge", {"extra_answers": ["a"]}) == "judge_extra"
    assert PROMPTS.template_name("judge", {"extra_answers": []}) == "judge"
    assert "beside the screen" in _text(_fill("judge"))
    assert "beside the screen" not in _text(_fill("judge", extra_answers=[]))


def test_ask_again_adds_the_reply_and_what_is_expected() -> None:
    request = _fill("choice")
    again = PROMPTS.ask_again(request, "the second one {{last}}")
    assert again.messages[: len(request.messages)] == request.messages
    assert [m.role for m in again.messages[-2:]] == ["assistant", "user"]
    assert again.messages[-2].parts == ("the second one {{last}}",)
    assert "0 to 1" in str(again.messages[-1].parts[0])
    assert PROMPTS.ask_again(request, " \n").messages[-2].parts == ("(no text)",)


def test_every_prompt_that_asks_for_an_index_says_the_range() -> None:
    assert "from 0 to 1." in _text(_fill("choice"))
    assert "from 0 to 1." in _text(_fill("verify"))


def test_load_replacement_changes_that_hash_only_and_keeps_the_again_section(tmp_path: Path) -> None:
    (tmp_path / "choice.txt").write_bytes(b"=== user ===\r\nPick for {{question}}:\r\n{{candidates}}\r\n")
    prompts = Prompts.load(tmp_path)
    changed = {name for name, digest in prompts.hashes().items() if digest != PROMPTS.hashes()[name]}
    assert changed == {"choice"}
    request = prompts.fill("choice", VARIABLES)
    assert request.messages[0].parts == (
        "Pick for Where is the lamp?:\n0: On the desk.\n1: " + VARIABLES["candidates"][1],
    )
    assert [m.role for m in request.messages] == ["user"]
    assert "one integer" in str(prompts.ask_again(request, "x").messages[-1].parts[0])


def test_load_built_in_copied_has_the_same_hashes(tmp_path: Path) -> None:
    for path in BUILT_IN.glob("*.txt"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert Prompts.load(tmp_path).hashes() == PROMPTS.hashes()


USER = "=== user ===\n{{question}}\n{{candidates}}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("=== user ===\n{{question}}", r"\{\{candidates\}\} somewhere"),
        (USER + "{{scene}}", r"found \{\{scene\}\}"),
        (USER + "{{ question }}", r"found \{\{ question \}\}"),
        (USER + "{{question", "placeholders like"),
        (USER + "=== again ===\n{{images}}", "again"),
        (USER + "=== notes ===\nx", "notes"),
        (USER + USER, "once each"),
        ("hello\n" + USER, "section header"),
        ("=== system ===\n{{question}} {{candidates}}", "=== user ==="),
        ("", "=== user ==="),
        (USER + "\udcff", "UTF-8"),
    ],
)
def test_load_bad_prompt_names_file_and_fault(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "choice.txt").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError, match=message) as caught:
        Prompts.load(tmp_path)
    assert "choice.txt" in str(caught.value)


def test_load_images_not_alone_on_their_line_raises(tmp_path: Path) -> None:
    (tmp_path / "answer_one.txt").write_text("=== user ===\n{{question}} {{images}}")
    with pytest.raises(InputError, match="alone on its line"):
        Prompts.load(tmp_path)


def test_load_folder_with_unknown_or_no_prompt_raises(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none of them"):
        Prompts.load(tmp_path)
    (tmp_path / "chioce.txt").write_text(USER)
    with pytest.raises(InputError, match=r"chioce\.txt"):
        Prompts.load(tmp_path)
