"""Grounding descriptions: of one object, of several, of none; and the groups that counting shares."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.scene.color_names import COLOR_NAMES
from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.names import FIXTURES, count_word, may_be_called, with_article
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.world import UNCOLORED, Phrase, World

_WHOLE = ("the {text}", "{this} the {text}", "find the {text}", "please show me the {text}", "I mean the {text}")
_SPLIT = (
    "{this} {a_noun}. {it} {be} {where}",
    "there {be} {a_noun} {where}",
    "{a_noun} that {be} {where}",
    "the {object} {be} {a_noun}. you find {them} {where}",
)
_SEVERAL = ("the {g}", "all the {g}", "find all {g}", "all of the {g}", "every one of the {g}")
_COUNTED = ("the {n} {g}", "all {n} {g}")
_PAIR = ("both {g}", "the two {g}")
_MOST = 12
"""Largest group one asks for."""
_ABSENT = (
    "piano", "bathtub", "bicycle", "guitar", "fireplace", "printer", "ladder", "vacuum cleaner", "suitcase",
    "blackboard", "washing machine", "fan", "umbrella", "projector", "radiator", "stuffed animal", "vase", "hat",
)  # fmt: skip
"""Things one may ask for in vain."""


def single(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield declarative descriptions that fit exactly one object."""
    for i in world.askable:
        rivals = world.denotes(Phrase(world.objects[i].category), lenient=True).sum() > 1
        for phrase in describer.all(i):
            kind = f"{phrase.place or 'plain'} {'among rivals' if rivals else 'alone'}"
            yield Draft(kind, declare(phrase, rng), None, (i,), phrase.category)


def several(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield descriptions that fit two objects or more."""
    for group, positions in groups(world, describer):
        text = group_text(group, len(positions))
        forms = [(_SEVERAL, ""), (_PAIR if len(positions) == 2 else _COUNTED, count_word(len(positions)))]
        templates, number = forms[int(rng.integers(4) == 0)]
        kind = f"{group.place or ('room' if group.room else 'whole scene')}{' colored' if group.color else ''}"
        yield Draft(kind, worded(rng, templates, g=text, n=number), None, positions, group.category)


def none(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield descriptions that fit nothing, most of them one word away from something that is there."""
    movable = {i for i in world.askable if world.objects[i].category.rsplit(" ", 1)[-1] not in FIXTURES}
    for i in world.askable:
        o = world.objects[i]
        for phrase in (p for p in describer.all(i)[:16] if p.place not in ("closest to", "farthest from")):
            colors = [c for c in COLOR_NAMES if c != o.color and o.category not in UNCOLORED]
            if colors:
                wrong = replace(phrase, color=colors[int(rng.integers(len(colors)))])
                if not _may_exist(world, wrong):
                    yield Draft("wrong color", declare(wrong, rng), None, (), o.category)
            if phrase.room and len(world.rooms) > 1:
                other = replace(phrase, room=world.rooms[int(rng.integers(len(world.rooms)))])
                if not _may_exist(world, other):
                    yield Draft("wrong room", declare(other, rng), None, (), o.category)
        for place, anchor, text in describer.anchors(i, places=("on", "under", "in", "next to")):
            # Nobody looks for a door on a bed.
            if place != "next to" and not (i in movable and world.layout.longest[i] < world.layout.longest[anchor]):
                continue
            wrong = Phrase(o.category, "", "", place, anchor, text)
            # Only places where something does stand, so that the question is not absurd.
            if world.relations.holds[wrong.place][:, anchor].any() and not _may_exist(world, wrong):
                yield Draft("wrong place", declare(wrong, rng), None, (), o.category)
    # Annotators of a scan left things out: what they did not name may be there.
    for category in _ABSENT if world.relations.complete else ():
        for room in world.rooms or ("",):
            absent = Phrase(category, room=room if rng.integers(2) else "")
            if not any(may_be_called(o.category, category) for o in world.objects):
                yield Draft("absent category", declare(absent, rng), None, (), category)


def groups(world: World, describer: Describer) -> Iterator[tuple[Phrase, tuple[int, ...]]]:
    """Yield clear descriptions of two objects or more with their positions."""
    for phrase, positions in counted_groups(world, describer):
        if len(positions) > 1:
            yield phrase, positions


def counted_groups(world: World, describer: Describer) -> Iterator[tuple[Phrase, tuple[int, ...]]]:
    """Yield clear descriptions of one object or more that may be asked for in the plural."""
    seen: set[Phrase] = set()
    for i in world.askable:
        o, room, color = world.objects[i], world.room_of[i], world.color_of(i)
        base = [Phrase(o.category), *([Phrase(o.category, color)] if color else [])]
        options = [*base, *(replace(p, room=room) for p in base if room)]
        for place in ("on", "in", "under", "next to"):
            for anchor in np.flatnonzero(world.relations.holds[place][i]).tolist():
                text = describer.shortest(anchor) if anchor in describer.plain else None
                if text is not None and describer.may_anchor(i, anchor):
                    options += [replace(p, place=place, anchor=anchor, anchor_text=text.text) for p in base]
        for phrase in options:
            if phrase in seen:
                continue
            seen.add(phrase)
            positions = tuple(np.flatnonzero(world.denotes(phrase)).tolist())
            if len(positions) <= _MOST and world.is_clear(phrase):
                yield phrase, positions


def group_text(group: Phrase, count: int) -> str:
    """Return a group's description in the plural: "black chairs around the table"."""
    return f"{group.nouns} {group_where(group, count)}".strip()


def group_where(group: Phrase, count: int) -> str:
    """Return where a group is; several seats next to a table are around it."""
    seats = group.category.rsplit(" ", 1)[-1] in ("chair", "stool")
    if count > 2 and group.place == "next to" and seats and "table" in group.anchor_text:
        return group.where.replace("next to", "around", 1)
    return group.where


def declare(phrase: Phrase, rng: np.random.Generator) -> str:
    """Return a description as a sentence or a noun phrase."""
    many = phrase.be == "are"
    this = "these are" if many else "this is"
    if not phrase.where or phrase.place in ("closest to", "farthest from") or rng.integers(2):
        return worded(rng, _WHOLE, text=phrase.text, this=this)
    return worded(
        rng,
        _SPLIT,
        a_noun=with_article(phrase.noun, phrase.category),
        where=phrase.where,
        be=phrase.be,
        this=this,
        it="they" if many else "it",
        them="them" if many else "it",
        object="objects" if many else "object",
    )


def _may_exist(world: World, phrase: Phrase) -> bool:
    """Return whether something may be taken for what the phrase describes, near colours included."""
    bare = world.denotes(replace(phrase, color=""), lenient=True)
    return any(
        not phrase.color or world.colors_alike(world.color_of(int(i)), phrase.color) for i in np.flatnonzero(bare)
    )
