"""Data of a page as scripts beside it: a page opened from disk may load a script, and may not read any other file.

Each file hands one text of JSON to the page's own script, which parses it: nothing in it is ever code or markup.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from typing import Any

from schemas import storage

RECEIVER = "splat"
"""Function of the page that takes a name and a text of JSON."""


def script_of(name: str, data: Any) -> bytes:
    """Return a script that hands data to the page.

    Args:
        name: What the page asked for; ASCII letters, digits and dashes.
        data: Plain data.
    """
    return f"{RECEIVER}({_quoted(name)},{_quoted(safe_json(data))});\n".encode("ascii")


def safe_json(data: Any) -> str:
    """Return JSON in ASCII in which nothing can end an HTML element or begin a comment."""
    text = json.dumps(data, ensure_ascii=True, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


class DataFolder:
    """Files that belong to one page; what an earlier page left there is removed at the end.

    Args:
        root: The folder, a path or URI.
        name: Its name as the page's links see it.
    """

    def __init__(self, root: str, name: str) -> None:
        self.root, self.name = root, name
        self._kept: set[str] = set()

    def script(self, name: str, data: Any) -> int:
        """Write data as `<name>.js`; return its bytes."""
        return self.file(f"{name}.js", script_of(name, data))

    def file(self, name: str, content: bytes) -> int:
        """Write a file; return its bytes."""
        storage.write_bytes_atomic(storage.join(self.root, name), content)
        self._kept.add(name)
        return len(content)

    def picture(self, content: bytes, ending: str) -> str:
        """Write a picture under the hash of its content, unless it is there; return its link."""
        name = f"{hashlib.sha256(content).hexdigest()[:20]}.{ending}"
        if name not in self._kept and not storage.exists(storage.join(self.root, name)):
            storage.write_bytes_atomic(storage.join(self.root, name), content)
        self._kept.add(name)
        return self.link(name)

    def link(self, name: str) -> str:
        """Return how the page names a file of the folder."""
        return f"{self.name}/{name}"

    def tidy(self, endings: Iterable[str] = (".js", ".jpg", ".png", ".webp")) -> None:
        """Remove files with these endings that were not written now."""
        for name in storage.list_files(self.root, recursive=True):
            if name not in self._kept and name.endswith(tuple(endings)):
                storage.remove(storage.join(self.root, name))


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
