"""The frame of every page: one HTML file with its style and script inside and its data in a folder beside it.

Whatever comes from a run is escaped here, or set as text by the script. The page's policy allows its own scripts by
hash, and what they themselves load ('strict-dynamic'), which is how data come in without reading files; no other
script, no network, no frame, no form.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from jobs.scoring.sheets import Sheet

HERE = Path(__file__).parent
SHARED = ("dom.js", "views.js", "question.js", "list.js")
"""Scripts of every page, in order; they share one scope."""


@dataclass(frozen=True, slots=True)
class Section:
    """A tab of the page."""

    id: str
    """Its place in the address."""
    title: str
    """Its name."""
    body: str
    """Its markup."""


def document(name: str, head: str, sections: Sequence[Section], *, data: str, script: str) -> str:
    """Return a page.

    Args:
        name: Title, any text.
        head: Markup below the title.
        sections: Tabs in order; without JavaScript all are shown one below the other.
        data: Folder with the page's data, as the page sees it.
        script: File that begins its work, such as "report.js".
    """
    style = (HERE / "page.css").read_text(encoding="utf-8")
    parts = "\n".join((HERE / file).read_text(encoding="utf-8") for file in (*SHARED, script))
    early, code = (HERE / "early.js").read_text(encoding="utf-8"), f'(() => {{\n"use strict";\n{parts}}})();\n'
    policy = (
        "default-src 'none'; base-uri 'none'; form-action 'none'; img-src 'self' file:; "
        f"style-src '{_hash(style)}'; script-src '{_hash(early)}' '{_hash(code)}' 'strict-dynamic'"
    )
    tabs = "".join(f'<a href="#{section.id}">{escape(section.title)}</a>' for section in sections)
    bodies = "".join(
        f'<section id="{section.id}" aria-label="{escape(section.title)}">{section.body}</section>'
        for section in sections
    )
    return "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark"><meta name="referrer" content="no-referrer">',
            f'<meta name="description" content="Answers about splat scenes, and what led to each: {escape(name)}">',
            f"<title>{escape(name)} · SplatReasoner</title><script>{early}</script><style>{style}</style></head>",
            f'<body data-folder="{escape(data)}" data-name="{escape(name)} · SplatReasoner">',
            '<a class="skip" href="#main">Skip to the content</a>',
            f'<header><div class="bar"><h1>{escape(name)}</h1>',
            '<button id="theme" type="button" hidden>Theme: system</button></div>',
            f'{head}</header><nav id="tabs" aria-label="Sections">{tabs}</nav>',
            f'<main id="main" tabindex="-1">{bodies}',
            '<section id="question" aria-label="Question" hidden></section></main>',
            '<dialog id="large" aria-label="Picture"></dialog>',
            "<footer><p>Made by <code>splatreasoner</code>. Keys: <kbd>/</kbd> search, <kbd>j</kbd> <kbd>k</kbd> next "
            "and previous question, <kbd>o</kbd> overlays, <kbd>Esc</kbd> back to the list.</p></footer>",
            f"<script>{code}</script></body></html>\n",
        ]
    )


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def sheet_table(sheet: Sheet, *, open_note: bool = True) -> str:
    """Return a sheet as markup."""
    head = "".join(
        f'<th scope="col"{"" if place < sheet.words else _NUMBER}>{escape(column)}</th>'
        for place, column in enumerate(sheet.columns)
    )
    rows = "".join(
        "<tr>"
        + "".join(
            f'<th scope="row">{escape(cell)}</th>'
            if place == 0
            else f"<td{'' if place < sheet.words else _NUMBER}>{escape(cell)}</td>"
            for place, cell in enumerate(row)
        )
        + "</tr>"
        for row in sheet.rows
    )
    title = escape(sheet.title)
    note = f"<p>{escape(sheet.note)}</p>" if open_note and sheet.note else ""
    return (
        f'<figure class="sheet"><figcaption>{title}</figcaption>'
        f'<div class="scroll" tabindex="0" role="region" aria-label="{title}">'
        f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>{note}</figure>"
    )


_NUMBER = ' class="number"'


def plot_box(title: str, svg: str, legend: Sequence[str] = (), note: str = "", kind: str = "") -> str:
    """Return a plot with its title and legend as markup.

    Args:
        title: What it shows.
        svg: The plot.
        legend: Names of its series, in the order of their colours.
        note: How to read it.
        kind: Class of its box; "single" for plots of one series.
    """
    keys = "".join(f'<li><span class="key s{place}"></span>{escape(name)}</li>' for place, name in enumerate(legend))
    return (
        f'<figure class="plotted {kind}"><figcaption>{escape(title)}</figcaption>'
        + (f'<ul class="legend">{keys}</ul>' if keys else "")
        + f'<div class="plotbox" tabindex="0" role="region" aria-label="Plot: {escape(title)}">{svg}</div>'
        + (f"<p>{escape(note)}</p>" if note else "")
        + "</figure>"
    )


def question_section(note: str, orders: Sequence[tuple[str, str]]) -> Section:
    """Return the tab with the list of questions, which the script fills.

    Args:
        note: What the words of the filters mean.
        orders: Value and name of each order of the list.
    """
    choices = "".join(f'<option value="{value}">{escape(name)}</option>' for value, name in orders)
    body = f"""<h2>Questions</h2>
<noscript><p class="notice">The list of questions needs JavaScript; everything else does not.</p></noscript>
<form id="filters" role="search" aria-label="Filter questions">
<div id="labels" role="group" aria-label="Outcome"></div>
<label>Task <select id="task"><option value="">all</option></select></label>
<label>Category <select id="category"><option value="">all</option></select></label>
<label>Scene <select id="scene"><option value="">all</option></select></label>
<label>Order <select id="order">{choices}</select></label>
<label class="wide">Search
<input id="find" type="search" autocomplete="off" placeholder="id, question or answer"></label>
</form>
<p id="count" role="status" aria-live="polite"></p>
<ol id="rows"></ol>
<nav id="pages" aria-label="Pages of the list"><button id="earlier" type="button">‹ Earlier</button>
<span id="page"></span><button id="later" type="button">Later ›</button></nav>
<p class="note">{escape(note)}</p>"""
    return Section("questions", "Questions", body)
