"""Sphinx: the pages of this folder, and the API reference from the docstrings (`make docs`)."""

from __future__ import annotations

import re
import sys
from importlib.metadata import version as installed
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

project = html_title = "SplatReasoner"
author = "The SplatReasoner developers"
version = release = installed("splatreasoner")
extensions = ["myst_parser", "sphinx.ext.apidoc", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]

default_role = "code"
napoleon_numpy_docstring = False
apidoc_modules = [
    {
        "path": f"../{package}",
        "destination": f"api/{package}",
        "module_first": True,
        "automodule_options": {"members", "undoc-members"},
    }
    for package in ("schemas", "pipeline", "workers", "jobs")
]
autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
autodoc_typehints_format = "short"

myst_heading_anchors = 3
html_theme = "furo"
html_show_sourcelink = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["width.css"]


_WHOLE: dict[str, list[str]] = {}


def plain_text(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Make reStructuredText of a docstring, which is plain text in Google style: |x|, * and x_ mean themselves.

    In a module's, indented lines that follow a sentence are formulas, shown as they stand.
    """
    parts = re.split("(`[^`]*`)", "\n".join(lines))
    text = "".join(part if part.startswith("`") else re.sub(r"([|*]|_\b)", r"\\\1", part) for part in parts)
    lines[:] = text.split("\n")
    if what == "module":
        for place in range(len(lines) - 1, 0, -1):
            inside, before = (lines[n].startswith("    ") for n in (place, place - 1))
            if inside and not before and lines[place - 1] and not lines[place - 1].startswith("- "):
                lines[place:place] = ["", "::", ""]
            elif before and not inside and lines[place]:
                lines.insert(place, "")
    _WHOLE[name] = list(lines)


def whole_sentence(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Take back what was made of a field's line: what comes before a colon there is no type."""
    kept = _WHOLE.pop(name, lines)
    if what in ("attribute", "data", "property"):
        lines[:] = kept


def function_like_its_module(app: Sphinx, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Leave a function that is called like its module to the module's own entry: two would share one name."""
    shadows = what == "module" and getattr(obj, "__module__", "").endswith(f".{name}")
    return True if shadows and f"{app.env.docname.split('/')[-1]}.{name}" == obj.__module__ else None


def link_own_names(app: Sphinx, doctree: nodes.document) -> None:
    """Link a short name of a type to what its module calls so, never to something else that ends alike."""
    for link in doctree.findall(pending_xref):
        if link["refdomain"] == "py":
            link.attributes.pop("refspecific", None)  # where it is there, even as False, endings are searched
            found = getattr(sys.modules.get(link.get("py:module")), link["reftarget"], None)
            if isinstance(found, type):
                link["reftarget"] = f"{found.__module__}.{found.__qualname__}"


def setup(app: Sphinx) -> None:
    """Connect the above, before and after sections are read (500)."""
    app.connect("autodoc-process-docstring", plain_text, priority=400)
    app.connect("autodoc-process-docstring", whole_sentence, priority=600)
    app.connect("autodoc-skip-member", function_like_its_module)
    app.connect("doctree-read", link_own_names)
