"""Reading a question: which thing is meant, how it stands to others, and what is asked of it.

Works on the groups of `tagging.py` in one pass from left to right. It knows grammar, not sentences: a noun takes the
colours and sizes before it, a relation joins the thing before it to the thing after it, and what the sentence opens
with tells what is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

from pipeline.models.symbolic.lexicon import nouns_of
from pipeline.models.symbolic.phrases import NOTHING, Kind, Link, Phrase, Query
from pipeline.models.symbolic.tagging import Token, tag
from pipeline.models.symbolic.uses import useful_names

_BE = frozenset({"is", "are", "was", "were", "be", "am", "being", "been"})
_ASK = frozenset({"what", "which", "whats"})
_AUXILIARY = _BE | {"do", "does", "did", "can", "could", "has", "have", "will", "would", "should", "might"}
_BACK = frozenset({"it", "they", "and", "but"})
"""Words after which a description goes on about its subject."""
_RELATIVE = frozenset({"that", "which", "who"})
_FIND = frozenset(
    {"find", "see", "spot", "leave", "left", "keep", "kept", "put", "locate", "look", "located", "place", "placed"}
)
"""Verbs with which "where" asks for a place even when somebody does something."""
_PERSON = frozenset({"i", "we", "you", "one", "someone", "somebody", "me", "my", "us", "they"})
_PAIRS = {
    "left right": ({"left"}, {"right"}),
    "above under": ({"above", "over", "higher"}, {"below", "under", "beneath", "underneath", "lower"}),
    "in front of behind": ({"front"}, {"behind"}),
    "on under": ({"on"}, {"under", "below", "beneath", "underneath"}),
}
"""Relations one is asked to choose from, and the words for each."""
_SOMETHING = frozenset({"something", "anything", "somewhere", "anywhere", "place", "way"})
_LOOKING = frozenset({"where", "check", "exists", "identify", "unknown"})
"""Kinds of question that, about something the vocabulary has no name for, may be about what serves a purpose."""
_MAX_DEPTH = 6
"""Longest chain of relations that is followed."""


@dataclass(slots=True)
class _Draft:
    """A noun phrase while it is being read."""

    words: str = ""
    exact: frozenset[str] = frozenset()
    kinds: frozenset[str] = frozenset()
    colors: list[str] = field(default_factory=list)
    sizes: list[str] = field(default_factory=list)
    state: str = ""
    extreme: str = ""
    plural: bool = False
    room: str = ""
    links: list[tuple[str, list[_Draft]]] = field(default_factory=list)
    at: int = 0

    def freeze(self, depth: int = 0) -> Phrase:
        links = [] if depth >= _MAX_DEPTH else self.links
        return Phrase(
            self.words,
            self.exact,
            self.kinds,
            tuple(dict.fromkeys(self.colors)),
            tuple(dict.fromkeys(self.sizes)),
            self.state,
            self.extreme,
            self.plural,
            self.room,
            tuple(
                Link(relation, ends[0].freeze(depth + 1), ends[1].freeze(depth + 1) if len(ends) > 1 else None)
                for relation, ends in links
                if ends
            ),
        )


@dataclass(slots=True)
class _Reading:
    """What one pass over the groups found."""

    things: list[_Draft]
    """Noun phrases in order, unnamed ones included."""
    states: list[str]
    """State words that stand for themselves ("is it open or closed")."""
    free_colors: list[str]
    """Colours said of the subject after a verb."""
    options: list[_Draft]
    """Things joined by "or"."""
    dangling: list[str]
    """Relations that no thing follows: "which is closer?"."""


@lru_cache(maxsize=4096)
def parse_question(question: str, vocabulary: tuple[str, ...]) -> Query:
    """Return a question as the rules understand it.

    Args:
        question: A question or a descriptive sentence.
        vocabulary: Category names the nouns are matched to.
    """
    groups = tag(question, nouns_of(vocabulary))
    words = tuple(word for group in groups if group.tag != "pause" for word in group.text.split())
    kind, measure = _kind(words, groups)
    reading = _read(groups)
    verbs = [i for i, group in enumerate(groups) if group.text in _AUXILIARY]
    if kind == "check" and "or" in words and len(set(reading.free_colors)) > 1:
        kind, measure = "color", "choose"
    query = _query(kind, measure, reading, words, verbs[-1] if verbs else -1)
    if query.kind in _LOOKING and query.target.words and not query.target.named and useful_names(words):
        return replace(query, kind="use", measure="can" if query.kind in ("check", "exists") else query.measure)
    return query


def _kind(words: tuple[str, ...], groups: Sequence[Token]) -> tuple[Kind, str]:
    """Tell what is asked from the words a question opens with and a few that stand anywhere."""
    if not words:
        return "unknown", ""
    text = " ".join(words)
    opening = _opening(groups)
    first = opening[0] if opening else ""
    has = set(words)
    asks = first in _ASK or first in {"where", "how", "on", "in"} or first in _AUXILIARY
    extremes = [g for g in groups if g.tag == "extreme" or (g.tag == "relation" and g.value in ("nearest", "farthest"))]
    if first in {"why", "when", "who", "whose"}:
        return "unknown", ""
    if "how many" in text or text.startswith(("count ", "number of")):
        return "count", ""
    if "color" in has and ("what" in has or "which" in has):
        return "color", ""
    if has & {"material", "made"} and has & _ASK:
        return "material", ""
    if "room" in has and ("what room" in text or "which room" in text):
        return "room", ""
    if side := _side(words):
        return "side", side
    if "same room" in text or "one room" in text:
        return "same room", ""
    if "used for" in text or "purpose of" in text or "function of" in text:
        return "purpose", ""
    states = [g.value for g in groups if g.tag == "state"]
    if "state of" in text or "status of" in text or ("or" in has and len(set(states)) > 1):
        return "state", ""
    if "or" in has and extremes and asks:
        return "compare", extremes[0].value
    if first == "where" or (first in _AUXILIARY and "where" in has):
        return ("use", "where") if _for_somebody(words, _FIND | {"know", "tell"}) else ("where", "")
    if first in _ASK and _for_somebody(words, frozenset({"find", "see"})):
        return "use", ""
    if "have you seen" in text or "did you see" in text:
        return "where", ""
    if "is it possible" in text or "would it be possible" in text:
        return "use", "can"
    if first in _ASK and "there to" in text:
        return "use", ""
    if text.startswith("i mean") or "looking for" in text or "look for the" in text:
        return "describe", ""
    if first in {"how", "i", "im", "i'm", "we"} or (has & {"i", "i'm"} and not asks):
        return "use", ""
    if first in _ASK and extremes and extremes[0].tag == "extreme" and _names_a_thing(groups, extremes[0]):
        return "which", extremes[0].value
    if first == "which" and any(g.tag == "noun" for g in groups[:5]):
        return "which", extremes[0].value if extremes else ""
    if first in _ASK:
        return "identify", ""
    if "point out" in text or "show me" in text:
        return "describe", ""
    if first in _AUXILIARY and "to" in has and has & _SOMETHING:
        return "use", "can"
    if text.startswith(("is there", "are there", "do you see", "can you see", "can i see", "is any", "are any")) or (
        "does" in has and "have" in has
    ):
        return "exists", ""
    if first in {"can", "could", "should", "would"} and _for_somebody(words, frozenset({"say", "see"})):
        return "use", "can"
    if first in _AUXILIARY:
        return "check", ""
    return "describe", ""


def _side(words: tuple[str, ...]) -> str:
    """Return the pair of relations a question lets one choose from: "left or right", "above or below"."""
    text = " ".join(words)
    if "which side" in text or "what side" in text:
        return "left right"
    if "or" not in words:
        return ""
    before, after = set(words[: words.index("or")]), set(words[words.index("or") :])
    for pair, (first, second) in _PAIRS.items():
        if (before & first and after & second) or (before & second and after & first):
            return pair
    return ""


def _opening(groups: Sequence[Token]) -> list[str]:
    """Return the words of the last sentence or clause that asks: "I am cold. What can I use?" asks in the second."""
    starts = [0]
    for index, group in enumerate(groups):
        if group.tag == "pause" and group.text in ".,;:!" and index + 1 < len(groups):
            starts.append(index + 1)
    for start in reversed(starts):
        words = [word for group in groups[start : start + 4] for word in group.text.split()]
        if words and (
            words[0] in _ASK | {"where", "how", "why", "when", "who", "whose"}
            or (words[0] in _AUXILIARY and start == 0)
        ):
            return words
    return [word for group in groups[:4] for word in group.text.split()]


def _names_a_thing(groups: Sequence[Token], extreme: Token) -> bool:
    """Return whether a noun follows: "the shortest lamp" singles out a lamp, "the shortest thing" anything."""
    after = groups[list(groups).index(extreme) + 1 :]
    return bool(after) and after[0].tag in ("noun", "color")


def _for_somebody(words: tuple[str, ...], looking: frozenset[str]) -> bool:
    """Return whether somebody wants to do something other than to look for a thing."""
    for index in range(len(words) - 1):
        if words[index] in {"can", "could", "should", "would", "do", "might", "to"} and words[index + 1] in _PERSON:
            return index + 2 >= len(words) or words[index + 2] not in looking
    return "to" in words and bool({"use", "used", "go", "need", "want"} & set(words))


def _read(groups: Sequence[Token]) -> _Reading:
    reading = _Reading([], [], [], [], [])
    pending = _Draft()
    subject: _Draft | None = None
    last: _Draft | None = None
    head: _Draft | None = None
    waiting: tuple[str, list[_Draft]] | None = None
    copula = relative = joined = False
    for index, group in enumerate(groups):
        if group.tag == "pause" or (group.tag == "word" and group.text in _BACK):
            if group.text == "and" and waiting is not None and waiting[0] == "between" and len(waiting[1]) == 1:
                joined = True
            elif group.text == "and" and pending.colors and not pending.words:
                pass
            else:
                head, copula, relative, joined = subject, False, False, False
                if group.text != "and":
                    waiting = None
                if pending.colors or pending.sizes:
                    _settle(pending, subject, reading)
                    pending = _Draft()
        elif group.tag == "color":
            pending.colors.append(group.value)
            if not _noun_follows(groups, index):
                _settle(pending, last if relative else subject, reading)
                pending = _Draft()
        elif group.tag == "size":
            pending.sizes.append(group.value)
            if not _noun_follows(groups, index):
                _settle(pending, last if relative else subject, reading)
                pending = _Draft()
        elif group.tag == "extreme":
            pending.extreme = group.value
            if not _noun_follows(groups, index) and (subject is not None):
                subject.extreme, pending.extreme = group.value, ""
        elif group.tag == "state":
            if _noun_follows(groups, index):
                pending.state = group.value
            else:
                reading.states.append(group.value)
        elif group.tag == "relation":
            head_now = head if head is not None else last
            if head_now is None:
                head_now = _Draft()
                reading.things.append(head_now)
                subject = last = head_now
            waiting = (group.value, [])
            head_now.links.append(waiting)
            head = None
        elif group.tag == "room":
            place = waiting[1] if waiting is not None else None
            if waiting is not None and not place:
                owner = next((d for d in reading.things if any(link is waiting for link in d.links)), None)
                if owner is not None:
                    owner.links = [link for link in owner.links if link is not waiting]
                    (subject or owner).room = group.value
                waiting = None
            elif subject is not None:
                subject.room = group.value
            else:
                pending.room = group.value
        elif group.tag in ("noun", "any"):
            if group.tag == "any" and not _stands_for_a_thing(groups, index):
                continue
            if subject is not None and group.tag == "any" and group.text in ("one", "ones", "it"):
                continue
            draft = pending
            draft.plural, draft.at = group.plural, index
            if group.tag == "noun":
                draft.words, draft.exact, draft.kinds = group.text, group.exact, group.kinds
            pending = _Draft()
            if _is_new_subject(draft, subject, waiting, groups, index):
                subject = _merged(subject, draft, reading)
                last = subject
                head = None
            elif waiting is not None and (not waiting[1] or joined):
                waiting[1].append(draft)
                reading.things.append(draft)
                last = draft
            else:
                reading.things.append(draft)
                subject = subject or draft
                last = draft
            if index and any(g.text == "or" for g in groups[max(0, index - 3) : index]):
                if not reading.options and len(reading.things) > 1:
                    reading.options.append(reading.things[-2])
                reading.options.append(draft)
            copula = relative = joined = False
        elif group.text in _RELATIVE:
            relative = True
        elif group.text in _BE:
            if not relative and subject is not None and not copula:
                head = subject
            copula = True
    reading.dangling = [relation for draft in reading.things for relation, ends in draft.links if not ends]
    return reading


def _noun_follows(groups: Sequence[Token], index: int) -> bool:
    """Return whether the modifiers from here on end in a noun."""
    for group in groups[index + 1 :]:
        if group.tag in ("noun", "any"):
            return True
        if group.tag in ("relation", "pause", "room") or (
            group.tag == "word" and group.text in _BE | _RELATIVE | {"or", "it"}
        ):
            return False
    return False


def _stands_for_a_thing(groups: Sequence[Token], index: int) -> bool:
    """A question word before a noun only asks; alone it stands for what is looked for."""
    if groups[index].text not in ("what", "which"):
        return True
    if index and groups[index].text == "which" and groups[index - 1].tag != "pause":
        return False
    following = groups[index + 1 : index + 5]
    for group in following:
        if group.tag in ("noun", "any"):
            return False
        if group.tag == "word" and group.text in _AUXILIARY:
            return True
        if group.tag in ("relation", "pause"):
            return True
    return True


def _is_new_subject(
    draft: _Draft, subject: _Draft | None, waiting: tuple[str, list[_Draft]] | None, groups: Sequence[Token], index: int
) -> bool:
    """The first thing is the subject; "What is the red object on ..." names its subject a second time."""
    if subject is None:
        return True
    if waiting is not None and not waiting[1]:
        return False
    unnamed = not subject.words and not subject.links
    return unnamed and not any(g.text == "or" for g in groups[max(0, index - 3) : index])


def _merged(subject: _Draft | None, draft: _Draft, reading: _Reading) -> _Draft:
    if subject is None:
        reading.things.append(draft)
        return draft
    draft.colors = subject.colors + draft.colors
    draft.extreme = draft.extreme or subject.extreme
    draft.room = draft.room or subject.room
    reading.things[reading.things.index(subject)] = draft
    return draft


def _sides(things: Sequence[_Draft], asked_at: int) -> tuple[Phrase, Phrase | None, tuple[Phrase, ...]]:
    """Return what is placed, what it is placed by, and what is faced from there.

    What is placed is named after the verb that asks: "is the lamp left or right of the bed", "which side of the bed is
    the lamp on", "when you face the bed, is the lamp on its left", "I am at the bed, looking toward the door: is ...".
    """
    named = [draft for draft in {id(draft): draft for draft in things}.values() if draft.words]
    after = [draft for draft in named if draft.at > asked_at]
    if not after:
        return NOTHING, None, ()
    rest = [draft for draft in named if draft is not after[0]]
    plain = [replace(draft.freeze(), state="", links=()) for draft in (after[0], *rest)]
    return plain[0], plain[1] if len(plain) > 1 else None, tuple(plain[2:3])


def _settle(pending: _Draft, thing: _Draft | None, reading: _Reading) -> None:
    """Give colours and sizes said after a verb to the thing they are said of."""
    reading.free_colors += pending.colors
    if thing is not None:
        thing.colors += pending.colors
        thing.sizes += pending.sizes


def _query(kind: Kind, measure: str, reading: _Reading, words: tuple[str, ...], asked_at: int) -> Query:
    things = reading.things
    if reading.states and things and not things[0].state and kind not in ("state",):
        things[0].state = reading.states[0]
    target = things[0].freeze() if things else NOTHING
    options = tuple(option.freeze() for option in reading.options)
    reference = None
    if kind == "room":
        # "In which room is the stove?" reads as a place inside the stove.
        named = [draft for draft in things if draft.words]
        target = replace(named[0].freeze(), links=()) if named and not things[0].words else target
    if kind == "side":
        target, reference, options = _sides(things, asked_at)
    if kind == "same room":
        named = list({id(draft): draft for draft in things if draft.words}.values())
        target = named[0].freeze() if named else target
        target = replace(target, links=tuple(link for link in target.links if link.relation != "in"))
        options = tuple(draft.freeze() for draft in named[1:])
    if kind == "compare":
        anchors = [end for draft in things for relation, ends in draft.links if relation == measure for end in ends]
        reference = anchors[0].freeze() if anchors else None
        options = tuple(o.freeze() for o in reading.options if not any(o is a for a in anchors)) or options
    if kind == "state" and not measure:
        measure = " ".join(dict.fromkeys(reading.states))
    return Query(kind, target, options, measure, reference, tuple(reading.free_colors), words)
