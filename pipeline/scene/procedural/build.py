"""Building a furnished apartment from a seed: plan, walls, openings, furniture, Gaussians, and a recorded walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.scene.objects import SceneObject
from pipeline.scene.procedural.gaze import record
from pipeline.scene.procedural.home import Home
from pipeline.scene.procedural.layout import Room, make_layout
from pipeline.scene.procedural.openings import add_switches, hang_doors, open_windows
from pipeline.scene.procedural.placement import RoomPlacer
from pipeline.scene.procedural.rooms import FURNISH
from pipeline.scene.procedural.splatting import splat
from pipeline.scene.procedural.vocabulary import VOCABULARY
from pipeline.scene.procedural.walk import stroll
from pipeline.scene.procedural.walls import SIDES, structure
from pipeline.scene.scene import Scene
from schemas.errors import InputError

LEAST_GAUSSIANS, MOST_GAUSSIANS = 5_000, 20_000_000
"""Bounds of what may be asked for; large apartments need more than the lower one."""


@dataclass(frozen=True, slots=True)
class ProceduralScene:
    """A built scene with the truth about it."""

    scene: Scene
    """Gaussians, views, and category and instance of every Gaussian."""
    objects: tuple[SceneObject, ...]
    """Every instance with its box, colour, states and relation; walls, floors, ceilings, doors and windows included."""
    rooms: tuple[Room, ...]
    """Rooms with their floor rectangles."""


def build_apartment(
    seed: int,
    *,
    rooms: int = 4,
    gaussians: int = 80_000,
    views: int = 120,
    width: int = 320,
    height: int = 240,
    sh_degree: int = 1,
) -> ProceduralScene:
    """Return a furnished apartment and the views of a person who walked through it.

    The same arguments give the same scene. Contents depend on `seed` and `rooms` only; `gaussians`
    changes how finely they are sampled.

    Args:
        seed: Any non-negative integer.
        rooms: Number of rooms, 1 to 24.
        gaussians: Gaussians wanted; the scene has within 3 % of it.
        views: Recorded views, at least 1.
        width: Image width, pixels.
        height: Image height, pixels.
        sh_degree: Degree of the spherical harmonics, 0 (no highlights) to 3.

    Raises:
        InputError: An argument is out of range, or `gaussians` is too few for the contents.
    """
    for name, value, low, high in (
        ("seed", seed, 0, 2**63),
        ("rooms", rooms, 1, 24),
        ("gaussians", gaussians, LEAST_GAUSSIANS, MOST_GAUSSIANS),
        ("views", views, 1, 100_000),
        ("width", width, 1, 16_384),
        ("height", height, 1, 16_384),
        ("sh_degree", sh_degree, 0, 3),
    ):
        if not low <= value <= high:
            raise InputError("apartment", field=name, expected=f"{low} to {high}", found=value)
    contents, sampling, path = (np.random.default_rng([seed, part]) for part in range(3))
    home = furnish(rooms, contents)
    splats, semantics = splat(home.things, gaussians, VOCABULARY, sh_degree, sampling)
    recorded = record(home, stroll(home, path), views, width, height, path)
    names = [room.name for room in home.layout.rooms]
    return ProceduralScene(
        scene=Scene(f"apartment-{seed}", splats, recorded, semantics),
        objects=tuple(thing.describe(names[thing.room]) for thing in home.things),
        rooms=home.layout.rooms,
    )


def furnish(rooms: int, rng: np.random.Generator) -> Home:
    """Return an apartment with everything in it."""
    home = Home(make_layout(rooms, rng))
    surfaces: dict[int, dict[str, int]] = {number: {} for number in range(rooms)}
    names = ["floor", "ceiling", *(side.name for side in SIDES)]
    for index, (model, number) in enumerate(structure(home.layout, rng)):
        placed = home.add(model, (0.0, 0.0, 0.0), 0.0, number)
        surfaces[number][names[index % len(names)]] = placed.instance
    placers = [RoomPlacer(home, number, surfaces[number], rng) for number in range(rooms)]
    hang_doors(home, placers, rng)
    for placer in placers:
        open_windows(placer)
        add_switches(placer)
        FURNISH[placer.room.kind](placer)
    return home
