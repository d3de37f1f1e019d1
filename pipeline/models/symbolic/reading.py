"""Second step of reading a question: the things it speaks of, and how they stand to each other.

One pass over the groups of `tagging.py` from left to right. It knows grammar, not sentences: a noun takes the colours
and sizes before it, and a relation joins the thing before it to the thing after it. After "it", "and" or a verb that
is not in a relative clause, what is said is said of the subject.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pipeline.models.symbolic.phrases import Link, Phrase
from pipeline.models.symbolic.tagging import Token

BE = frozenset({"is", "are", "was", "were", "be", "am", "being", "been"})
AUXILIARY = BE | {"do", "does", "did", "can", "could", "has", "have", "will", "would", "should", "might"}
_BACK = frozenset({"it", "they", "and", "but"})
"""Words after which a description goes on about its subject."""
_RELATIVE = frozenset({"that", "which", "who"})
_SAME_AGAIN = frozenset({"one", "ones", "it"})
"""Words that mean the subject once more."""
_MAX_DEPTH = 6
"""Longest chain of relations that is followed."""
_NEAR_OR = 3
"""Groups looked back for the "or" that offers a thing."""


@dataclass(slots=True)
class Draft:
    """A noun phrase while it is being read; the fields are those of `Phrase`."""

    words: str = ""
    exact: frozenset[str] = frozenset()
    kinds: frozenset[str] = frozenset()
    colors: list[str] = field(default_factory=list)
    sizes: list[str] = field(default_factory=list)
    state: str = ""
    extreme: str = ""
    plural: bool = False
    room: str = ""
    links: list[tuple[str, list[Draft]]] = field(default_factory=list)
    at: int = 0
    """Group it was read from."""

    def freeze(self, depth: int = 0) -> Phrase:
        """Return the phrase; relations that nothing follows are dropped."""
        links = [] if depth >= _MAX_DEPTH else [link for link in self.links if link[1]]
        return Phrase(
            words=self.words,
            exact=self.exact,
            kinds=self.kinds,
            colors=tuple(dict.fromkeys(self.colors)),
            sizes=tuple(dict.fromkeys(self.sizes)),
            state=self.state,
            extreme=self.extreme,
            plural=self.plural,
            room=self.room,
            links=tuple(
                Link(relation, ends[0].freeze(depth + 1), ends[1].freeze(depth + 1) if len(ends) > 1 else None)
                for relation, ends in links
            ),
        )


@dataclass(slots=True)
class Reading:
    """What one pass found."""

    things: list[Draft] = field(default_factory=list)
    """Noun phrases in order, unnamed ones included."""
    states: list[str] = field(default_factory=list)
    """States said of the subject: "is it open or closed"."""
    colors: list[str] = field(default_factory=list)
    """Colours said of the subject: "is it blue"."""
    options: list[Draft] = field(default_factory=list)
    """Things joined by "or"."""

    @property
    def named(self) -> list[Draft]:
        """Noun phrases that name a thing."""
        return [thing for thing in self.things if thing.words]


def read(groups: Sequence[Token]) -> Reading:
    """Return what the groups of a question speak of."""
    return _Reader(groups).read()


class _Reader:
    """State of one pass."""

    def __init__(self, groups: Sequence[Token]) -> None:
        self._groups = groups
        self._reading = Reading()
        self._pending = Draft()
        """Modifiers read so far of the next noun."""
        self._subject: Draft | None = None
        self._last: Draft | None = None
        self._head: Draft | None = None
        """What the next relation belongs to; None for the last thing."""
        self._open: list[Draft] | None = None
        """Ends of a relation that waits for its thing."""
        self._between: list[Draft] | None = None
        """Ends of the last "between"."""
        self._relative = False
        """Inside "that is ..."."""

    def read(self) -> Reading:
        for index, group in enumerate(self._groups):
            if group.tag == "pause" or (group.tag == "word" and group.text in _BACK):
                self._turn_back(group)
            elif group.tag in ("color", "size"):
                (self._pending.colors if group.tag == "color" else self._pending.sizes).append(group.value)
                if not self._noun_follows(index):
                    self._settle(self._last if self._relative else self._subject)
            elif group.tag == "extreme":
                if self._noun_follows(index) or self._subject is None:
                    self._pending.extreme = group.value
                else:
                    self._subject.extreme = group.value
            elif group.tag == "state":
                if self._noun_follows(index):
                    self._pending.state = group.value
                else:
                    self._reading.states.append(group.value)
            elif group.tag == "relation":
                self._relate(group.value)
            elif group.tag == "room":
                self._place(group.value)
            elif group.tag in ("noun", "any"):
                self._name(group, index)
            elif group.text in _RELATIVE:
                self._relative = True
            elif group.text in BE and not self._relative:
                self._head = self._subject
        return self._reading

    def _turn_back(self, group: Token) -> None:
        if group.text == "and":
            if self._between is not None and len(self._between) == 1:
                self._open = self._between
                return
            if self._pending.colors:
                return
        else:
            self._open = self._between = None
        self._head, self._relative = self._subject, False
        if self._pending.colors or self._pending.sizes:
            self._settle(self._subject)

    def _relate(self, relation: str) -> None:
        head = self._head or self._last
        if head is None:
            head = self._subject = self._last = Draft()
            self._reading.things.append(head)
        self._open = []
        self._between = self._open if relation == "between" else self._between
        head.links.append((relation, self._open))
        self._head = None

    def _place(self, room: str) -> None:
        """A room is where the subject is; the "in" before it is no relation to a thing."""
        if self._open is not None and not self._open:
            for thing in self._reading.things:
                thing.links = [link for link in thing.links if link[1] is not self._open]
            self._open = None
        # A thing named since "between" was said is where it is said to be; so are things between which one chooses.
        owner = self._last if self._between is not None or self._reading.options else self._subject
        (owner or self._subject or self._pending).room = room

    def _name(self, group: Token, index: int) -> None:
        again = self._subject is not None and group.text in _SAME_AGAIN
        if group.tag == "any" and (again or not self._stands_for_a_thing(index)):
            return
        draft, self._pending = self._pending, Draft()
        draft.plural, draft.at = group.plural, index
        if group.tag == "noun":
            draft.words, draft.exact, draft.kinds = group.text, group.exact, group.kinds
        offered = any(g.text == "or" for g in self._groups[max(0, index - _NEAR_OR) : index])
        if self._open is not None and (not self._open or self._open is self._between):
            self._open.append(draft)
            self._reading.things.append(draft)
            self._open = None
        elif self._subject is not None and not self._subject.words and not self._subject.links and not offered:
            self._rename_subject(draft)
        else:
            self._reading.things.append(draft)
            self._subject = self._subject or draft
        self._last = draft
        if offered:
            if not self._reading.options and len(self._reading.things) > 1:
                self._reading.options.append(self._reading.things[-2])
            self._reading.options.append(draft)
        self._relative = False

    def _rename_subject(self, draft: Draft) -> None:
        """Give an unnamed subject its name: "what is the red object", "the object is a backpack"."""
        assert self._subject is not None
        draft.colors = self._subject.colors + draft.colors
        draft.extreme = draft.extreme or self._subject.extreme
        draft.room = draft.room or self._subject.room
        self._reading.things = [draft if thing is self._subject else thing for thing in self._reading.things]
        self._subject, self._head = draft, None

    def _settle(self, thing: Draft | None) -> None:
        """Give colours and sizes said after a verb to the thing they are said of."""
        self._reading.colors += self._pending.colors
        if thing is not None:
            thing.colors += self._pending.colors
            thing.sizes += self._pending.sizes
            self._pending = Draft()

    def _noun_follows(self, index: int) -> bool:
        """Return whether the modifiers from here on end in a noun."""
        for group in self._groups[index + 1 :]:
            if group.tag in ("noun", "any"):
                return True
            if group.tag in ("relation", "pause", "room") or group.text in BE | _RELATIVE | {"or", "it", "of"}:
                return False
        return False

    def _stands_for_a_thing(self, index: int) -> bool:
        """A question word before a noun only asks; alone it stands for what is looked for."""
        if self._groups[index].text not in ("what", "which"):
            return True
        if self._groups[index].text == "which" and index and self._groups[index - 1].tag != "pause":
            return False
        for group in self._groups[index + 1 : index + 5]:
            if group.tag in ("noun", "any"):
                return False
            if group.tag in ("relation", "pause") or group.text in AUXILIARY:
                return True
        return True
