"""What things are for: which ones serve a purpose that a question names, and what purpose a thing has."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from pipeline.models.symbolic.words import listed_in

_SEATS = "couch, chair, armchair, sofa chair, office chair, stool, bench, ottoman, bed, seat, folded chair"
_BINS = "trash can, trash bin, bin, recycling bin"
_LAMPS = "lamp, light, ceiling light"

USES: tuple[tuple[str, str, str], ...] = (
    (
        "sleeping",
        "sleep- | nap | lie down | sleepy | tired | bedtime | night rest",
        "bed, couch, mattress, pillow",
    ),
    ("resting the head", "rest head | lay head | lie head", "pillow, cushion"),
    ("relaxing", "relax- | rest | lounge", "couch, armchair, sofa chair, bed"),
    ("sitting", "sit | seat", _SEATS),
    ("putting up the feet", "feet | legs", "ottoman, stool"),
    ("washing hands", "wash hand | dirty hand | wash face | rinse | clean hand", "sink, soap dispenser, soap dish"),
    ("washing dishes", "wash dish | clean dish | dirty dish | wash plate | wash cup", "dishwasher, sink"),
    ("washing clothes", "wash cloth- | do laundry", "washing machine, laundry basket"),
    ("holding dirty clothes", "dirty cloth-", "laundry hamper, laundry basket, washing machine"),
    ("laundry", "laundry", "washing machine, laundry basket, laundry hamper, clothes dryer"),
    ("drying clothes", "dry cloth-", "clothes dryer, rack"),
    ("drying hair", "dry hair", "hair dryer, towel"),
    ("drying", "dry hand | dry off | dry my", "towel, paper towel roll, paper towel dispenser"),
    ("bathing", "bathe | bath | soak | wash body", "bathtub, shower"),
    ("showering", "shower", "shower, bathtub"),
    ("washing", "wash", "sink, bathtub, shower, washing machine"),
    ("brushing teeth", "brush teeth", "sink"),
    ("using the toilet", "toilet | pee | flush", "toilet"),
    ("cooking", "cook | fry | boil | soup | pasta", "stove, oven, microwave"),
    ("baking", "bake | roast | cake | pizza", "oven, toaster oven"),
    ("toasting bread", "toast", "toaster, toaster oven"),
    ("heating food", "heat food | heat up | warm up | reheat | leftover | warm food", "microwave, stove, oven"),
    (
        "keeping food cold",
        "food cold | food fresh | keep cold | keep cool | milk | chill- | food spoil",
        "refrigerator, mini fridge",
    ),
    ("keeping food", "hungry | snack | grocer-", "refrigerator, kitchen cabinet, cabinet"),
    ("eating", "eat | dinner | lunch | breakfast | meal | dine", "dining table, table, kitchen counter, counter"),
    ("making coffee", "coffee", "coffee maker, coffee kettle, cup"),
    ("making tea", "tea", "coffee kettle, cup"),
    (
        "drinking",
        "thirst- | drink | get water | glass of",
        "cup, bottle, water bottle, refrigerator, sink, water cooler",
    ),
    ("reading", "read | story | novel", "book, bookshelf, lamp, couch"),
    (
        "keeping books",
        "store book | put book | keep book | arrange book | magazine | library",
        "bookshelf, shelf, desk",
    ),
    (
        "giving light",
        "light | bright | brighter | illuminat- | dark | too dark | see nothing",
        f"{_LAMPS}, light switch",
    ),
    ("blocking light", "too bright | sun | glare | privacy | block light | darken", "curtain, blinds, window"),
    ("looking out", "outside | view | look out | weather", "window, door"),
    ("moving air", "fresh air | airflow | hot | cool down | cool off | cool room | stuffy | breeze", "fan, window"),
    ("warmth", "cold | warm | freez- | chilly", "blanket, radiator, fireplace"),
    ("heating", "heat room | warm room", "radiator, fireplace"),
    ("watching films", "movie | film | watch | news | show | series", "tv, projector screen, laptop, monitor"),
    ("music", "music | song | tune", "speaker, guitar, piano, keyboard piano, headphones"),
    ("making music", "play music | instrument | play song | strum", "guitar, piano, keyboard piano"),
    ("telling the time", "time | o'clock | hour | late | appointment", "clock, alarm clock"),
    ("waking up", "wake", "alarm clock"),
    (
        "throwing things away",
        "throw | dispose | garbage | trash | waste | rubbish | litter | get rid",
        _BINS,
    ),
    ("recycling", "recycl-", "recycling bin, trash can"),
    ("hanging up coats", "hang coat | hang jacket | coat", "coat rack, wardrobe, closet"),
    ("hanging things up", "hang", "coat rack, closet, wardrobe, rack"),
    ("keeping clothes", "cloth- | dressed | shirt | outfit | sock", "wardrobe, dresser, closet, clothes"),
    ("keeping documents", "document | paperwork", "file cabinet, desk"),
    ("storing things", "store | storage | put away", "cabinet, wardrobe, shelf, bookshelf, dresser, storage bin, box"),
    ("writing", "write | letter", "desk, whiteboard, blackboard, table"),
    ("taking notes", "note", "paper, desk, whiteboard, laptop"),
    ("drawing", "draw | sketch", "whiteboard, blackboard, paper, desk"),
    ("working", "work | study | homework | essay", "desk, laptop, office chair, table"),
    (
        "computing",
        "email | internet | comput- | online | code | browse | surf",
        "laptop, monitor, computer tower, desk",
    ),
    ("typing", "typing | type", "keyboard, laptop"),
    ("printing", "print", "printer, copier"),
    ("calling", "call | phone", "telephone"),
    ("charging", "charge | plug | outlet", "power outlet, power strip"),
    (
        "looking at oneself",
        "see myself | look myself | see face | look face | reflect- | makeup | shave | comb | hair looks",
        "mirror",
    ),
    ("cleaning the floor", "vacuum- | clean floor | sweep | dust", "vacuum- cleaner, broom, dustpan"),
    ("wiping up", "spill | wipe | mop", "paper towel roll, towel, tissue box"),
    ("blowing the nose", "sneez- | nose", "tissue box"),
    ("ironing", "wrinkle- | iron", "ironing board"),
    ("exercise", "exercis- | workout | work out | muscle-", "dumbbell, bicycle, ball"),
    ("riding", "bike | ride | cycl-", "bicycle"),
    ("climbing", "reach high | reach top | climb", "ladder, stool, stairs"),
    ("putting out fire", "fire", "fire extinguisher, fire alarm"),
    ("travelling", "travel | trip | pack | journey", "suitcase, luggage, backpack"),
    ("carrying things", "carry | school", "backpack, bag, basket"),
    ("going through", "leave room | enter | exit", "door"),
    ("weighing", "weigh", "scale"),
    ("clearing smoke", "smoke | steam", "range hood, fire alarm, window"),
    ("playing", "play | toy | child", "ball, stuffed animal, guitar, piano, tv"),
    ("decoration", "decorat- | art", "picture, poster, plant, potted plant, decoration"),
    ("greenery", "nature | water plant | garden", "plant, potted plant"),
    ("putting things on", "put down | place | surface", "table, coffee table, desk, nightstand, counter"),
)
"""A purpose, the words that call for it and what serves it, most useful first.

Calls are separated by bars; words side by side must all stand in the question, in any of their forms. A hyphen stands
for any ending.
"""

_ENDINGS = ("", "s", "es", "ing", "ed", "y")


@lru_cache(maxsize=4096)
def useful_names(words: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of things that serve what the words speak of, most useful first.

    A purpose called for by more words is the more particular one and drives out the others; among those with as many
    words, longer ones go first.

    Args:
        words: Words of a question, lower case.
    """
    hits: list[tuple[tuple[int, int], int, tuple[str, ...]]] = []
    for order, (calls, names) in enumerate(_CALLS):
        strengths = [
            (len(call), sum(map(len, call)))
            for call in calls
            if all(any(_calls_for(word, start) for word in words) for start in call)
        ]
        if strengths:
            hits.append((max(strengths), -order, names))
    if not hits:
        return ()
    most = max(words for (words, _), _, _ in hits)
    ranked = sorted((hit for hit in hits if hit[0][0] == most), reverse=True)
    return tuple(dict.fromkeys(name for *_, names in ranked for name in names))


def purpose_of(name: str) -> str:
    """Return what a thing is used for, or "" where that is not known."""
    ranked = [(names.index(name), order) for order, (_, names) in enumerate(_CALLS) if name in names]
    return USES[min(ranked)[1]][0] if ranked else ""


def _calls_for(word: str, call: str) -> bool:
    if call.endswith("-"):
        return word.startswith(call[:-1])
    return word in {call + ending for ending in _ENDINGS} or word in (f"{call}{call[-1]}ing", f"{call.rstrip('e')}ing")


def _calls(text: str) -> Sequence[tuple[str, ...]]:
    return [tuple(call.split()) for call in text.split("|")]


_CALLS = tuple((_calls(words), listed_in(names)) for _, words, names in USES)
