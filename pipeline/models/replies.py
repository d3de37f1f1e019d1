"""Reply parsers: pure and strict. What can be read in one way only is read; everything else is None, never a guess.

All parsers look past the same wrappings, which change no meaning: a reasoning block such as `<think>...</think>` before
the reply (also one whose opening tag stands in the server's template), a code fence around it, bold marks, quotes, list
marks, full-width digits and colons, a trailing full stop, and (but in free text) a line break written as backslash-n.
A reply may be JSON where a server was asked for it, or where a model took to it by itself; docs/prompts.md lists the
forms and the words that are read in languages other than English.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.models.quoting import one_line

_REASONING = r"[<\[◁](?:think|thinking|thought|reasoning)[>\]▷]"
_END = _REASONING.replace("(?:", "/(?:", 1)
_THINKING = re.compile(rf"\A\s*{_REASONING}.*?{_END}|\A.*?{_END}(?=\s*(?:\n|\Z))", re.DOTALL | re.IGNORECASE)
_OPEN_THINKING = re.compile(rf"\A\s*{_REASONING}", re.IGNORECASE)
_BOX = re.compile(r"<\|(?:begin|end)_of_box\|>")
_FENCE = re.compile(r"\A\s*```[\w-]*[ \t]*\n(.*?)\n?[ \t]*```\s*\Z", re.DOTALL)
_FENCED_JSON = re.compile(r"\A([^`0-9]*)```(?:json)?[ \t]*\n([{\[][^`]*)```([^`0-9]*)\Z", re.IGNORECASE)
_BULLET = re.compile(r"\A[-*•]\s+")
_NUMBERED = re.compile(r"\A[0-9]{1,2}[.)]\s+")
_QUOTES = "\"'`“”‘’"
_WIDE = str.maketrans("０１２３４５６７８９：，。！（）", "0123456789:,.!()")
"""Full-width forms as Chinese and Japanese have them, one for one, so that positions in a line stay."""

_PICTURE = "图像|图片|圖像|圖片|画像|图|圖"
_IMAGE = rf"(?:(?:image|picture|bild)\s+|(?:{_PICTURE})\s*)#?"
_INDEX_LINE = re.compile(
    r"(?:(?:the |best |final |selected |chosen |beste |die )*"
    rf"(?:index|answer|choice|antwort|image|picture|bild|答案|回答|索引|选择|選択|{_PICTURE})"
    r"(?: is| ist|是|は)?[:=]? *)?#?\(?\[?([0-9]{1,4})\]?\)?[.:]?",
    re.IGNORECASE,
)
_INDEX_ECHO = re.compile(r"([0-9]{1,4}):\s+\S.*")
_IMAGE_HEADER = re.compile(rf"\W*{_IMAGE}([0-9]{{1,4}})\W*", re.IGNORECASE)
_IMAGE_INLINE = re.compile(rf"\W*{_IMAGE}([0-9]{{1,4}})\s*(?::|[-–—]\s)[\s*_]*(\S.*)", re.IGNORECASE)
_IMAGE_MENTION = re.compile(rf"\W*{_IMAGE}[0-9]", re.IGNORECASE)
_YES = frozenset({"yes", "ja", "是", "是的", "有", "はい"})
_NO = frozenset({"no", "nein", "否", "不是", "没有", "沒有", "いいえ"})
_VERDICT = re.compile(
    rf"{_IMAGE}([0-9]{{1,4}})\s*(?:[:=]|[-–—]\s)\s*({'|'.join(sorted(_YES | _NO, key=len, reverse=True))})"
    r"\s*(?:[.,;:!(–—-]+(.*))?",
    re.IGNORECASE | re.DOTALL,
)
_YES_OR_NO = re.compile(r"\b(?:yes|no|ja|nein)\b|是的|不是|否|没有|沒有|はい|いいえ", re.IGNORECASE)
_NOTHING = frozenset({"none", "(none)", "keine", "无", "無", "なし"})
_MARK = re.compile(r"your\s+mark\s*(?::|=|\bis\b)\s*([1-5])(?:\s*(?:/|out of)\s*5)?\.?", re.IGNORECASE)
_MARK_BELOW = re.compile(r"(your\s+mark\s*[:=])\s*\n\s*", re.IGNORECASE)
_BARE_MARK = re.compile(r"([1-5])(?:\s*/\s*5)?\.?")
_CAPTION_LABEL = re.compile(r"\A(?:caption|description)\s*:\s*", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ImageAnswer:
    """A reply to the answer prompt."""

    index: int
    """Which image the model chose, 0-based."""
    answer: str
    """What it answered."""


def parse_text(text: str) -> str | None:
    """Return a free-text reply without the wrappings, or None when nothing is left."""
    return _unwrap(text) or None


def parse_caption(text: str) -> str | None:
    """Return the description of a picture in one line, without a label before it, or None when nothing is left."""
    return _CAPTION_LABEL.sub("", " ".join(_unwrap(text).replace("*", "").split())) or None


def parse_evidence(text: str, vocabulary: Sequence[str], k: int) -> tuple[str, ...] | None:
    """Return the evidence categories of a reply, most useful first.

    Args:
        text: One name a line; a comma-separated line, a JSON list of names or an object with such a list in
            `categories` also counts. What is no name of the vocabulary is passed over.
        vocabulary: Names that may be chosen; case does not count.
        k: Names kept, at least 1.

    Returns:
        Up to k names of the vocabulary without repeats; () for an explicit "none" or an empty list in `categories`;
        None when no name can be read.
    """
    # A prompt shows names as data, so a model gives that form back; closer forms come later and win.
    names = {_name(one_line(name)): name for name in vocabulary} | {_name(name): name for name in vocabulary}
    names |= {name.casefold(): name for name in vocabulary} | {name: name for name in vocabulary}
    body = _unwrap(text)
    if _json(body) == {"categories": []}:
        return ()
    data = _value(body, "categories")
    lines = [item for item in data if isinstance(item, str)] if isinstance(data, list) else _lines(body)
    found: dict[str, None] = {}
    for line in lines:
        whole = _look_up(line, names)
        pieces = [whole] if whole is not None else [_look_up(piece, names) for piece in line.split(",")]
        if None not in pieces:
            found |= dict.fromkeys(piece for piece in pieces if piece is not None)
    if not found and _name(body) in _NOTHING:
        return ()
    return tuple(found)[:k] or None


def parse_index(text: str, count: int) -> int | None:
    """Return the index a reply names, 0 to count - 1.

    Either one line of the reply is an index and nothing else ("2", "Index: 2", "Image 2", "**2.**"), or the reply is
    JSON ({"index": 2}), or the whole reply is one candidate line given back ("2: the sofa is red"). Two different
    indices are none.
    """
    body = _unwrap(text)
    data = _value(body, "index")
    if isinstance(data, int) and not isinstance(data, bool):
        return data if 0 <= data < count else None
    lines = [_plain(line.replace("*", "")) for line in _lines(body) if line.strip()]
    found = {int(match.group(1)) for line in lines if (match := _INDEX_LINE.fullmatch(line))}
    if not found and len(lines) == 1 and (match := _INDEX_ECHO.fullmatch(lines[0])):
        found = {int(match.group(1))}
    return _single(found, count)


def parse_image_answer(text: str, count: int) -> ImageAnswer | None:
    """Return the image and the answer of a reply "Image i", line break, answer; also "Image i: answer" and JSON.

    Text before the one line that names the image is passed over. Two such lines, an index outside 0 to count - 1
    or a missing answer give None.
    """
    body = _unwrap(text)
    data = _json(body)
    if isinstance(data, dict):
        index, answer = data.get("image", data.get("index")), data.get("answer")
        if isinstance(index, bool) or not isinstance(index, int) or not isinstance(answer, str):
            return None
        return ImageAnswer(index, answer.strip()) if 0 <= index < count and answer.strip() else None
    lines = _lines(body)
    headers: list[tuple[int, int, str]] = []
    for number, line in enumerate(lines):
        narrow = line.translate(_WIDE)
        if match := _IMAGE_HEADER.fullmatch(narrow):
            headers.append((number, int(match.group(1)), ""))
        elif match := _IMAGE_INLINE.fullmatch(narrow):
            headers.append((number, int(match.group(1)), line[match.start(2) :]))
    if len(headers) != 1:
        return None
    number, index, inline = headers[0]
    answer = "\n".join([inline, *lines[number + 1 :]]).strip().strip("*").strip()
    return ImageAnswer(index, answer) if index < count and answer else None


def parse_yes_no(text: str, count: int) -> tuple[bool, ...] | None:
    """Return for every image whether the reply says "Image i: Yes"; also from a JSON object of such pairs.

    Every index from 0 to count - 1 must come exactly once. Words after the verdict are passed over unless they
    hold another yes or no; so are lines that do not begin with "Image".
    """
    body = _unwrap(text)
    data = _json(body)
    lines = [f"{key}: {value}" for key, value in data.items()] if isinstance(data, dict) else _lines(body)
    found: dict[int, bool] = {}
    for line in lines:
        plain = _NUMBERED.sub("", _plain(line.replace("*", "")))
        match = _VERDICT.fullmatch(plain)
        if match is None:
            if _IMAGE_MENTION.match(plain):
                return None
            continue
        index = int(match.group(1))
        if index in found or _YES_OR_NO.search(match.group(3) or ""):
            return None
        found[index] = match.group(2).lower() in _YES
    if count < 1 or sorted(found) != list(range(count)):
        return None
    return tuple(found[index] for index in range(count))


def parse_mark(text: str) -> int | None:
    """Return the mark of a judge's reply, 1 to 5: a line "Your mark: d", or a digit or {"mark": d} as a whole.

    A mark within a sentence is passed over, since a judge may quote the answer it marks, and an answer may name a mark.
    Two lines with different marks are none.
    """
    body = _unwrap(text).replace("*", "").translate(_WIDE)
    data = _json(body)
    if isinstance(data, dict):
        mark = data.get("mark")
        return mark if isinstance(mark, int) and not isinstance(mark, bool) and 1 <= mark <= 5 else None
    if match := _BARE_MARK.fullmatch(_plain(body)):
        return int(match.group(1))
    lines = _lines(_MARK_BELOW.sub(r"\1 ", body))
    found = {int(match.group(1)) for line in lines if (match := _MARK.fullmatch(_plain(line)))}
    return found.pop() if len(found) == 1 else None


def _unwrap(text: str) -> str:
    """Drop a reasoning block and a code fence; a reasoning block that never ends leaves nothing to read."""
    text = _BOX.sub("", _THINKING.sub("", text, count=1))
    if _OPEN_THINKING.match(text):
        return ""
    if match := _FENCE.fullmatch(text):
        text = match.group(1)
    return text.replace("\r\n", "\n").strip()


def _lines(body: str) -> list[str]:
    """Break lines also where a model wrote a backslash and an n, as some do when shown a format on one line."""
    return body.replace("\\n", "\n").split("\n")


def _plain(line: str) -> str:
    """Drop a bullet, bold marks, quotes, surrounding space and full-width forms."""
    return _BULLET.sub("", line.translate(_WIDE).strip()).strip().strip("*_").strip(_QUOTES).strip("*_ ")


def _name(line: str) -> str:
    """Drop also a list number and closing punctuation; case does not count."""
    return _NUMBERED.sub("", _plain(line)).strip("*_ ").rstrip(".,;:").strip(_QUOTES).strip().casefold()


def _look_up(line: str, names: Mapping[str, str]) -> str | None:
    forms = (line.strip(), line.strip().casefold(), _name(line))
    return next((names[form] for form in forms if form in names), None)


def _value(text: str, field: str) -> Any:
    """Return the value of a reply that is JSON, out of an object's field or its only field; else None."""
    data = _json(text)
    if not isinstance(data, dict):
        return data
    return data.get(field) if field in data or len(data) != 1 else next(iter(data.values()))


def _json(text: str) -> Any:
    """Return the value of a reply that is JSON, else None; a field given twice is unreadable.

    One fenced block of JSON may have words around it, but no digits: those could say something else.
    """
    if match := _FENCED_JSON.match(text):
        text = match.group(2)
    if text[:1] not in ("{", "["):
        return None
    try:
        return json.loads(text, strict=False, object_pairs_hook=_distinct)
    except (ValueError, RecursionError):
        return None


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(dict(pairs)) != len(pairs):
        raise ValueError("a field is given twice")
    return dict(pairs)


def _single(found: set[int], count: int) -> int | None:
    index = found.pop() if len(found) == 1 else -1
    return index if 0 <= index < count else None
