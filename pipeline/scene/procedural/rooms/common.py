"""What furnishers share: making things, chances, and the parts every room has."""

from __future__ import annotations

from pipeline.scene.procedural.filling import fill, fill_container
from pipeline.scene.procedural.furniture import BUILDERS
from pipeline.scene.procedural.furniture.fixtures import mat
from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.things import Model, Placed

TABLE_THINGS = ("book", "cup", "bowl", "plant", "candle", "tissue_box", "box", "bottle", "tray", "decoration", "laptop")
SHELF_THINGS = (
    "books",
    "books",
    "books",
    "book",
    "plant",
    "decoration",
    "basket",
    "box",
    "speaker",
    "alarm_clock",
    "candle",
    "hat",
    "stuffed_animal",
)
CABINET_THINGS = ("bowl", "cup", "plate", "bottle", "box", "books", "water_pitcher", "tissue_box", "ball", "clothes")
UNDER_BED = ("storage_container", "flat_suitcase", "shoe", "ball", "book", "storage_container", "dumbbell")
UNDER_TABLE = ("ball", "basket", "box", "shoe", "backpack", "dumbbell")
BEHIND_SEAT = ("suitcase", "guitar", "broom", "ladder", "suitcase", "backpack", "bag", "crate", "basket", "paper_bag")


def make(placer: RoomPlacer, name: str) -> Model:
    """Return a new thing from its builder."""
    return BUILDERS[name](placer.rng)


def chance(placer: RoomPlacer, probability: float) -> bool:
    """Return True with the given probability."""
    return bool(placer.rng.random() < probability)


def against(
    placer: RoomPlacer, name: str, *, gap: float = 0.03, corner: bool = False, front: float = 0.35
) -> Placed | None:
    """Make a thing and stand it against any wall."""
    return placer.against_wall(make(placer, name), gap=gap, corner=corner, front=front)


def stand(placer: RoomPlacer, *names: str, edge: bool = True) -> None:
    """Stand things on free floor; containers among them get contents."""
    for name in names:
        placed = placer.anywhere(make(placer, name), edge=edge)
        if placed and chance(placer, 0.7):
            fill_container(placer, placed)


def put_on(
    placer: RoomPlacer, holder: Placed | None, names: tuple[str, ...], count: int, kind: str = "", turn: float = 0.3
) -> None:
    """Put things on a piece of furniture, if it found a place itself."""
    if holder:
        fill(placer, holder, "on", names, count, kind=kind, turn=turn)


def put_in(placer: RoomPlacer, holder: Placed | None, names: tuple[str, ...], count: int) -> None:
    """Put things into a piece of furniture; closed ones have no slot and stay as they are."""
    if holder:
        fill(placer, holder, "in", names, count)


def put_under(placer: RoomPlacer, holder: Placed | None, names: tuple[str, ...], count: int) -> None:
    """Put things on the floor beneath a piece of furniture."""
    if holder:
        fill(placer, holder, "under", names, count)


def put_behind(placer: RoomPlacer, holder: Placed | None, names: tuple[str, ...] = BEHIND_SEAT, count: int = 1) -> None:
    """Put things on the floor between a seat's back and the wall."""
    if holder:
        fill(placer, holder, "behind", names, count)


def hang(placer: RoomPlacer, name: str, bottom: tuple[float, float], above: Placed | None = None) -> Placed | None:
    """Make a thing and hang it on a wall."""
    return placer.on_wall(make(placer, name), bottom=bottom, above=above)


def rug(placer: RoomPlacer, size: tuple[float, float], near: Placed | None = None, distance: float = 0.3) -> None:
    """Lay a rug or mat."""
    width, depth = (float(side * placer.rng.uniform(0.9, 1.1)) for side in size)
    placer.lay(mat(placer.rng, width, depth), near, distance=distance)


def finish(placer: RoomPlacer) -> None:
    """Ceiling light, and something behind an open door."""
    placer.under_ceiling(make(placer, "ceiling_light"))
    for door in [thing for thing in placer.home.by_room.get(placer.number, []) if thing.model.category == "door"]:
        if "open" in door.model.states and chance(placer, 0.8):
            for name in placer.rng.permutation(["broom", "backpack", "trash_can", "guitar", "ladder", "bag", "box"])[
                :4
            ]:
                if placer.behind_door(door, make(placer, str(name))):
                    break
