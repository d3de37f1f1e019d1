"""Object state recognition: open or closed, on or off, and whether something is on or in a thing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pipeline.scene.questions.draft import Draft, worded
from pipeline.scene.questions.names import capital, names
from pipeline.scene.questions.phrases import Describer
from pipeline.scene.questions.relations import RelationName, heads
from pipeline.scene.questions.world import World

_OPPOSITES = (("open", "closed"), ("on", "off"), ("full", "empty"), ("made", "unmade"), ("clean", "dirty"))
_LIT = ("lit", "unlit")
"""What on and off are called for a flame."""
_NO_LID = names("bucket, basket, hamper, crate, bowl, cup, bin, can, trashcan, rack, paper bag, bag, sink, bathtub")
"""Categories nobody calls open or closed."""
_EITHER = (
    "{be} the {o} {a} or {b}?",
    "{be} the {o} currently {a} or {b}?",
    "can you tell me if the {o} {be} {a} or {b}?",
)
_YES_NO = ("{be} the {o} {a}?", "{be} the {o} {a} right now?", "did someone leave the {o} {a}?")
_OCCUPIED = {
    "on": ("is there anything on the {o}?", "is something lying on the {o}?", "is there any object on top of the {o}?"),
    "under": (
        "is there anything under the {o}?",
        "is something stored under the {o}?",
        "is there an object under the {o}?",
    ),
}
_TOPS = names("table, desk, counter, nightstand, dresser, bench, stool")
"""Categories whose top is meant when one calls them empty."""
_SEATS = names("bed, couch, chair, armchair, shelf, bookshelf, stand")
_LEGGED = names("table, desk, bed, chair, couch, bench, nightstand, armchair")
"""Categories with room underneath."""
_FREE = ("is the top of the {o} empty?", "is the top of the {o} free?", "is the {o} clear of things?")


def states(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    """Yield object state questions: from stated states, and, where a scene states what stands where, occupancy."""
    unclosable = heads(world.objects, _NO_LID)
    for i in world.askable:
        o = world.objects[i]
        for pair in _OPPOSITES:
            held = [s for s in pair if s in o.states]
            phrase = describer.pick(i, rng)
            if len(held) != 1 or phrase is None or (pair[0] == "open" and unclosable[i]):
                continue
            shown = {s: f"turned {s}" if s in ("on", "off") else s for s in pair}
            if o.category == "candle":
                pair, held = _LIT, [_LIT[pair.index(held[0])]]
                shown = {s: s for s in pair}
            first = int(rng.integers(2))
            parts = {"o": phrase.text, "be": phrase.be, "a": shown[pair[first]], "b": pair[1 - first]}
            yield Draft(f"either {pair[0]}", worded(rng, _EITHER, **parts), capital(held[0]), (i,), o.category)
            asked = pair[int(rng.integers(2))]
            question = worded(rng, _YES_NO, o=phrase.text, be=phrase.be, a=shown[asked])
            yield Draft(f"is it {pair[0]}", question, "Yes" if asked == held[0] else "No", (i,), o.category)
    if world.relations.complete:
        yield from _occupancy(world, describer, rng)


def _occupancy(world: World, describer: Describer, rng: np.random.Generator) -> Iterator[Draft]:
    flat = heads(world.objects, _TOPS)
    kinds: tuple[tuple[RelationName, np.ndarray], ...] = (
        ("on", flat | heads(world.objects, _SEATS)),
        ("under", heads(world.objects, _LEGGED)),
    )
    for name, suitable in kinds:
        for i in world.askable:
            phrase = describer.pick(i, rng)
            if not suitable[i] or phrase is None or phrase.place == name:
                continue
            present = bool(world.relations.holds[name][:, i].any())
            if present != bool(world.relations.may_hold[name][:, i].any()):
                continue
            category = world.objects[i].category
            question = worded(rng, _OCCUPIED[name], o=phrase.text)
            yield Draft(f"anything {name} {present}", question, "Yes" if present else "No", (i,), category)
            if name == "on" and flat[i]:
                question = worded(rng, _FREE, o=phrase.text)
                yield Draft(f"free {present}", question, "No" if present else "Yes", (i,), category)
