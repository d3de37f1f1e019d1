"""Prompts: text files, one a stage, filled with a question's data and hashed into every record.

A prompt file has a section `=== user ===` and, where wanted, `=== system ===` and `=== again ===` (what is said after
a reply that could not be read). Placeholders are written `{{name}}`. All are replaced in one pass, so text that comes
from a question, a scene or a model is never expanded again, whatever braces it holds; it is quoted as data first
(`quoting`), so that it can neither close the tags a prompt puts around it nor begin a line. `{{images}}` stands alone
on a line; there each picture follows its label "Image i".
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pipeline.models.messages import ImagePart, Message, Request, Stage
from pipeline.models.quoting import one_line, several_lines
from schemas.errors import InputError

TemplateName = Literal[
    "evidence",
    "view_answer",
    "choice",
    "choice_image",
    "choice_image_text",
    "verify",
    "answer_one",
    "answer_many",
    "judge",
    "judge_extra",
    "caption",
    "caption_object",
    "answer_text",
    "answer_text_objects",
    "answer_blind",
]
"""One prompt file each: the stages, and the variants of `VARIANT_OF`."""

VARIANT_OF: Mapping[TemplateName, Stage] = {
    "choice_image": "choice",
    "choice_image_text": "choice",
    "judge_extra": "judge",
    "caption_object": "caption",
    "answer_text_objects": "answer_text",
}
"""Prompts that stand in for their stage's own: the choice by images or by both, the judge's for questions with several
accepted answers, the caption of one named object, and the answer from a list of objects."""

REQUIRED: Mapping[TemplateName, frozenset[str]] = {
    "evidence": frozenset({"question", "categories", "k"}),
    "view_answer": frozenset({"question", "images"}),
    "choice": frozenset({"question", "candidates"}),
    "choice_image": frozenset({"question", "images"}),
    "choice_image_text": frozenset({"question", "images", "candidates"}),
    "verify": frozenset({"question", "candidates"}),
    "answer_one": frozenset({"question", "images"}),
    "answer_many": frozenset({"question", "images"}),
    "judge": frozenset({"question", "answer", "prediction"}),
    "judge_extra": frozenset({"question", "answer", "prediction", "extra_answers"}),
    "caption": frozenset({"images"}),
    "caption_object": frozenset({"images", "object"}),
    "answer_text": frozenset({"question", "notes"}),
    "answer_text_objects": frozenset({"question", "notes"}),
    "answer_blind": frozenset({"question"}),
}
"""Placeholders that the user section of each prompt must hold."""

COUNTS = frozenset({"count", "last"})
"""Number of images or candidates, and the highest index: allowed in every prompt that shows any."""

BUILT_IN = Path(__file__).parent / "prompts"
REPLY_ECHO = 2_000
"""Characters of an unreadable reply repeated to the model: enough to see its mistake, bounded for the bill."""

_SECTION = re.compile(r"^=== *([a-z]+) *===$", re.MULTILINE)
_PLACEHOLDER = re.compile(r"\{\{([^{}\n]*)\}\}")


@dataclass(frozen=True, slots=True)
class Template:
    """One prompt file."""

    system: str
    """System message; empty for none."""
    user: str
    """User message."""
    again: str
    """User message after a reply that could not be read."""

    def sha256(self) -> str:
        """Return the hash of all three sections."""
        return hashlib.sha256(json.dumps([self.system, self.user, self.again]).encode()).hexdigest()


class Prompts:
    """The prompts of a run.

    Args:
        templates: One for every name.
    """

    def __init__(self, templates: Mapping[TemplateName, Template]) -> None:
        self._templates = dict(templates)
        self._hashes = {name: template.sha256() for name, template in templates.items()}

    @classmethod
    def load(cls, folder: Path | None = None) -> Prompts:
        """Return the built-in prompts, with the files of `folder` in place of those of the same name.

        Args:
            folder: Replacements, any of `<name>.txt`; None for the built-in prompts alone. A file without an
                "again" section keeps the built-in one.

        Raises:
            InputError: The folder holds no prompt or a .txt file of an unknown name; a file is not UTF-8, has an
                unknown section or placeholder, or lacks one it needs.
        """
        templates = {name: _read(BUILT_IN / f"{name}.txt", name, None) for name in REQUIRED}
        if folder is not None:
            for name, path in _replacements(Path(folder)).items():
                templates[name] = _read(path, name, templates[name])
        return cls(templates)

    def template_name(self, stage: Stage, variables: Mapping[str, Any]) -> TemplateName:
        """Return which prompt a call uses: the stage's, or the variant that its variables call for.

        Raises:
            InputError: The choice's design is unknown.
        """
        if stage == "judge" and variables.get("extra_answers"):
            return "judge_extra"
        if stage == "caption" and "object" in variables:
            return "caption_object"
        if stage == "answer_text" and variables.get("design") == "objects":
            return "answer_text_objects"
        if stage != "choice" or "design" not in variables:
            return stage
        match variables["design"]:
            case "image":
                return "choice_image"
            case "image_text":
                return "choice_image_text"
        raise InputError("prompt choice", field="design", expected="image or image_text", found=variables["design"])

    def sha256(self, name: TemplateName) -> str:
        """Return the hash of a prompt, as call rows record it."""
        return self._hashes[name]

    def hashes(self) -> dict[str, str]:
        """Return the hash of every prompt, as a run records them."""
        return {str(name): digest for name, digest in sorted(self._hashes.items())}

    def fill(self, stage: Stage, variables: Mapping[str, Any], images: Sequence[ImagePart] = ()) -> Request:
        """Return the request of a stage.

        Args:
            stage: Who asks.
            variables: Value of every placeholder of that stage but `images`, `count` and `last`: texts, numbers
                or lists of texts. Candidates become lines "i: text". A choice by images also has `design`.
            images: Pictures in order; empty for a stage that shows none.

        Raises:
            InputError: A variable is missing, or images were given to a stage without any or the other way round.
        """
        name = self.template_name(stage, variables)
        template = self._templates[name]
        if ("images" in REQUIRED[name]) != bool(images):
            expected = "at least one image" if "images" in REQUIRED[name] else "no image"
            raise InputError(f"prompt {name}", field="images", expected=expected, found=len(images))
        values = _values(name, variables, len(images))
        messages = [Message("user", _with_images(template.user, values, images))]
        if template.system:
            messages.insert(0, Message("system", (_substitute(template.system, values),)))
        return Request(stage, tuple(messages), dict(variables))

    def ask_again(self, request: Request, reply: str) -> Request:
        """Return the request that follows an unreadable reply: the reply, then what form is expected."""
        name = self.template_name(request.stage, request.variables)
        values = _values(name, request.variables, len(request.images()))
        turns = (
            Message("assistant", (several_lines(reply.strip()[:REPLY_ECHO]) or "(no text)",)),
            Message("user", (_substitute(self._templates[name].again, values),)),
        )
        return Request(request.stage, request.messages + turns, request.variables)


def _replacements(folder: Path) -> dict[TemplateName, Path]:
    paths = {path.stem: path for path in sorted(folder.glob("*.txt"))}
    found: dict[TemplateName, Path] = {name: paths.pop(name) for name in REQUIRED if name in paths}
    expected = f"prompt files named {', '.join(f'{name}.txt' for name in REQUIRED)}"
    if paths:
        raise InputError(folder, expected=expected, found=", ".join(f"{name}.txt" for name in paths))
    if not found:
        raise InputError(folder, expected=expected, found="none of them")
    return found


def _read(path: Path, name: TemplateName, fallback: Template | None) -> Template:
    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(path, expected="UTF-8 text", found=f"a bad byte at position {error.start}") from error
    pieces = _SECTION.split(text.replace("\r\n", "\n"))
    if pieces[0].strip():
        raise InputError(path, expected="a section header such as '=== user ===' first", found=repr(pieces[0][:40]))
    sections: dict[str, str] = {}
    for header, body in zip(pieces[1::2], pieces[2::2], strict=True):
        if header not in ("system", "user", "again") or header in sections:
            raise InputError(
                path, field=header, expected="the sections system, user and again, once each", found=header
            )
        sections[header] = body.strip("\n")
    if not sections.get("user", "").strip():
        raise InputError(path, field="user", expected="a section '=== user ===' with text", found="none")
    again = sections.get("again", fallback.again if fallback else "")
    if not again.strip():
        raise InputError(path, field="again", expected="a section '=== again ===' with text", found="none")
    template = Template(sections.get("system", ""), sections["user"], again)
    _check_placeholders(path, name, template)
    return template


def _check_placeholders(path: Path, name: TemplateName, template: Template) -> None:
    known = REQUIRED[name] | (COUNTS if REQUIRED[name] & {"images", "candidates"} else frozenset())
    for section in ("system", "user", "again"):
        text: str = getattr(template, section)
        used = set(_PLACEHOLDER.findall(text))
        allowed = known if section == "user" else known - {"images"}
        listed = ", ".join("{{" + word + "}}" for word in sorted(allowed))
        if unknown := sorted(used - allowed):
            raise InputError(path, field=section, expected=f"only {listed}", found="{{" + unknown[0] + "}}")
        if rest := re.search(r"\{\{|\}\}", _PLACEHOLDER.sub("", text)):
            raise InputError(path, field=section, expected="placeholders like {{question}}", found=repr(rest.group()))
        if section == "user" and (missing := sorted(REQUIRED[name] - used)):
            raise InputError(path, field=section, expected="{{" + missing[0] + "}} somewhere", found="it nowhere")
    if "images" in REQUIRED[name] and [line.strip() for line in template.user.split("\n")].count("{{images}}") != 1:
        raise InputError(path, field="user", expected="{{images}} once, alone on its line", found="another use of it")


def _values(name: TemplateName, variables: Mapping[str, Any], images: int) -> dict[str, str]:
    values = {}
    for placeholder in REQUIRED[name] - {"images"}:
        if placeholder not in variables:
            raise InputError(f"prompt {name}", field=placeholder, expected="a value", found="none")
        value = variables[placeholder]
        if placeholder == "candidates":
            values[placeholder] = "\n".join(f"{index}: {one_line(text)}" for index, text in enumerate(value))
        elif placeholder == "extra_answers":
            values[placeholder] = "\n".join(f"- {one_line(text)}" for text in value)
        elif placeholder in ("categories", "notes"):
            values[placeholder] = "\n".join(one_line(text) for text in value)
        else:
            values[placeholder] = one_line(str(value))
    count = len(variables["candidates"]) if "candidates" in REQUIRED[name] else images
    if "images" in REQUIRED[name] and count != images:
        expected = f"one for each of {images} images"
        raise InputError(f"prompt {name}", field="candidates", expected=expected, found=count)
    return values | {"count": str(count), "last": str(count - 1)}


def _substitute(text: str, values: Mapping[str, str]) -> str:
    return _PLACEHOLDER.sub(lambda match: values[match.group(1)], text)


def _with_images(text: str, values: Mapping[str, str], images: Sequence[ImagePart]) -> tuple[str | ImagePart, ...]:
    before, placeholder, after = text.partition("{{images}}")
    if not placeholder:
        return (_substitute(text, values),)
    # No part is blank: some servers refuse white space as a message part.
    parts: list[str | ImagePart] = [_substitute(before.rstrip("\n"), values)] if before.strip() else []
    for index, image in enumerate(images):
        parts += [f"Image {index}", image]
    if after.strip():
        parts.append(_substitute(after.lstrip("\n"), values))
    return tuple(parts)
