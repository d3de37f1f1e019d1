"""What things are for: the one table behind functional and world-knowledge questions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.scene.questions.names import names


@dataclass(frozen=True, slots=True)
class Use:
    """Something a person may want to do, and the categories that serve it."""

    action: str
    """After "I": "wash my hands"; empty where the thing is not used but spoken of."""
    serves: frozenset[str]
    """Categories one would name."""
    at: str
    """Preposition of "where can I ...?": "at", "on" or "in"; empty where the thing is no place."""
    needs: tuple[str, ...]
    """Situations in which someone wants it, each ending in its question."""
    also: frozenset[str] = frozenset()
    """Categories that would do, so that an answer naming them is not wrong."""
    something: str = ""
    """After "something to": "read"; empty where nobody says so."""
    things: str = ""
    """After "what can I": "sit on"; empty where nobody says so."""
    fixed: bool = False
    """Whether a room has it or not, so that "can I ... in the kitchen?" makes sense."""


USES: tuple[Use, ...] = (
    Use(
        "wash my hands",
        names("sink"),
        "at",
        ("my hands are dirty. what should I use?", "I just painted and need to clean my fingers. where do I go?"),
        names("bathtub, shower"),
        fixed=True,
    ),
    Use(
        "sit down",
        names("chair, office chair, armchair, couch, sofa chair, stool, bench, folded chair, seat"),
        "on",
        ("my legs are tired and I want to rest a moment. what can I use?", "a guest wants to take a seat. where?"),
        names("bed, ottoman, toilet, cushion"),
        "sit on",
        "sit on",
        fixed=True,
    ),
    Use(
        "take a nap",
        names("bed"),
        "on",
        ("I am very sleepy. where should I lie down?", "it is late and I am tired. which object do I need?"),
        names("couch, mattress, sofa chair, armchair"),
        "",
        "sleep on",
        fixed=True,
    ),
    Use(
        "watch a film",
        names("tv"),
        "on",
        ("the news is about to start. what should I switch on?", "I want to see tonight's match. which object helps?"),
        names("projector, monitor, laptop"),
        fixed=True,
    ),
    Use(
        "heat up leftovers",
        names("microwave"),
        "in",
        ("my soup has gone cold. what can I use to warm it quickly?", "I want popcorn in two minutes. what do I use?"),
        names("oven, stove, toaster oven"),
        fixed=True,
    ),
    Use(
        "fry an egg",
        names("stove"),
        "on",
        ("I would like a pan of hot pasta sauce. what do I need?", "I want to boil water in a pot. what do I turn on?"),
        names("oven"),
        fixed=True,
    ),
    Use(
        "keep milk cold",
        names("refrigerator, mini fridge"),
        "in",
        ("the butter is melting. where should I put it?", "I bought ice-cold drinks. where do they go?"),
        fixed=True,
    ),
    Use(
        "toast bread",
        names("toaster, toaster oven"),
        "in",
        ("I want crispy bread for breakfast. what should I use?", "my bread slices are too soft. what would help?"),
        names("oven"),
        fixed=True,
    ),
    Use(
        "throw away rubbish",
        names("trash can, trashcan, recycling bin, bin, trash bin"),
        "in",
        ("I have an empty wrapper in my hand. where does it go?", "I finished my apple. where do I leave the core?"),
        fixed=True,
    ),
    Use(
        "take a shower",
        names("shower, bathtub"),
        "in",
        ("I am sweaty after my run. what do I need?", "I want to wash my whole body. what should I use?"),
        fixed=True,
    ),
    Use(
        "",
        names("toilet"),
        "",
        ("I drank a lot of tea and must go urgently. what do I need?", "nature calls. what am I looking for?"),
    ),
    Use(
        "read a story",
        names("book"),
        "",
        ("I am bored and would like a story. what should I pick up?", "I want to learn something offline. what helps?"),
        names("bookshelf, paper, laptop"),
        "read",
        "read",
    ),
    Use(
        "store my books",
        names("bookshelf, shelf"),
        "on",
        ("I bought ten novels. where do I put them?", "I have a pile of magazines to arrange. what should I use?"),
        names("cabinet, desk, table, dresser"),
    ),
    Use(
        "see my own face",
        names("mirror"),
        "in",
        ("there may be something on my face. what should I look at?", "I want to check my hair. what do I use?"),
    ),
    Use(
        "check the time",
        names("clock, alarm clock"),
        "on",
        ("I must not miss my train. what should I look at?", "is it noon yet? which object would tell me?"),
        names("laptop, tv, monitor, telephone"),
    ),
    Use(
        "write an email",
        names("laptop, computer tower"),
        "on",
        ("I have to answer my mail. what should I use?", "I need to look something up online. what helps?"),
        names("monitor, keyboard, telephone"),
    ),
    Use(
        "play some music",
        names("guitar, piano, keyboard piano, speaker"),
        "on",
        ("we would like a song at the party. what can I play it on?", "I feel like making music. what do I take?"),
        names("laptop, tv"),
    ),
    Use(
        "",
        names("plant, potted plant"),
        "",
        ("something here needs water and light to live. what is it?", "what in here would wilt if nobody watered it?"),
    ),
    Use(
        "hang up my coat",
        names("coat rack, wardrobe, closet"),
        "in",
        ("I just came in from the rain. where does my coat go?", "I ironed my shirts. where do I hang them?"),
        names("chair, door"),
    ),
    Use(
        "wash my clothes",
        names("washing machine"),
        "in",
        ("my shirt has a stain. what should I put it in?", "all my socks are dirty. which machine do I need?"),
        names("sink, laundry basket, laundry hamper"),
        fixed=True,
    ),
    Use(
        "make more light",
        names("lamp, light, ceiling light"),
        "",
        ("it is too dark to read. what should I switch on?", "the sun has set. what do I turn on?"),
        names("window, candle"),
    ),
    Use(
        "print a document",
        names("printer"),
        "on",
        ("I need my ticket on paper. what should I use?", "I have a file and need a hard copy. what helps?"),
        names("copier"),
    ),
    Use(
        "let in fresh air",
        names("window"),
        "at",
        ("it smells of fish in here. what can I open?", "the air is stale. what should I open?"),
        names("door"),
        fixed=True,
    ),
    Use(
        "dry myself",
        names("towel"),
        "",
        ("I am dripping wet. what should I grab?", "I just got out of the water. what do I need?"),
    ),
    Use(
        "pack for a trip",
        names("suitcase, backpack, luggage, bag"),
        "",
        ("I am leaving for a week. what do I put my things in?", "I go hiking tomorrow. what carries my lunch?"),
        names("box, basket"),
    ),
    Use(
        "drink some water",
        names("cup, bottle, water bottle"),
        "",
        ("I am thirsty. what can I pour a drink into?", "I would like some tea. what do I drink it from?"),
        names("bowl, sink"),
        "drink from",
        "drink from",
    ),
    Use(
        "put on a warm layer",
        names("jacket, clothes"),
        "",
        ("it is freezing outside. what should I take?", "I feel cold on the way out. what do I wear?"),
        names("blanket, hat"),
    ),
)

ROOM_PURPOSES: tuple[tuple[str, frozenset[str], str], ...] = (
    ("cook dinner", names("stove, oven"), "which room would I go to to cook dinner?"),
    ("sleep", names("bed"), "in which room would I sleep at night?"),
    ("take a bath or a shower", names("bathtub, shower"), "where would I go to wash myself from head to toe?"),
    ("relax", names("couch"), "in which room would a family sit together in the evening?"),
    ("work", names("desk, office chair, computer tower"), "which room suits someone who works from home?"),
    ("brush my teeth", names("toilet, bathtub"), "in which room would I brush my teeth?"),
)
"""What a room is for, the categories that make it so, and the question."""


def present(use: Use, categories: Sequence[str]) -> tuple[str, ...]:
    """Return which of the categories serve the use, in their order and without repeats."""
    return tuple(dict.fromkeys(c for c in categories if c in use.serves))
