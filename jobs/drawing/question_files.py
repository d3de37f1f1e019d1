"""Pictures of a scene and of a question as files: the map, every view with its clusters, every grounding."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from jobs.drawing.map_sheet import map_sheet, scene_map
from jobs.drawing.overlays import laid_over
from jobs.drawing.question import Ids, QuestionArtist
from jobs.drawing.run_scene import RunScene
from jobs.drawing.to_draw import ToDraw
from jobs.pictures import contact_sheet, save_picture
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from schemas.run_folder import safe_name

MAP_FILE, SHEET_FILE = "map.png", "sheet.png"


def draw_files(
    scene_uri: str,
    output: Path,
    *,
    run: str = "",
    question_id: str = "",
    on_map: bool = True,
    sheet: bool = False,
    threads: int = 1,
) -> list[Path]:
    """Draw a scene from above, and the views and groundings of a question; return the files written.

    Args:
        scene_uri: Scene folder.
        output: Where the files go; made where it is missing.
        run: Run folder with the question.
        question_id: A committed question of the scene; empty for the map alone.
        on_map: Write `map.png`.
        sheet: Also write `sheet.png` with all pictures of the question.
        threads: Threads a picture.

    Raises:
        InputError: The scene is wrong, or the run has no such question over it.
    """
    asked = RunScene(run, scene_uri) if question_id else None
    question = None if asked is None else asked.to_draw(question_id)
    context = SceneContext(load_scene(scene_uri))
    groups: dict[int, Ids] = {}
    pictures: list[tuple[str, UInt8[np.ndarray, "H W 3"]]] = []
    if asked is not None and question is not None:
        artist = QuestionArtist(context, asked.method, threads)
        groups = artist.clusters(question)
        pictures = [*_views(artist, question, groups), *_groundings(artist, question)]
    written = [save_picture(color, output / f"{safe_name(name)}.png") for name, color in pictures]
    if sheet and pictures:
        written.append(save_picture(contact_sheet([color for _, color in pictures]), output / SHEET_FILE))
    if on_map:
        drawn = map_sheet(scene_map(context, threads), context.scene.gaussians.means, question, groups)
        written.append(save_picture(drawn, output / MAP_FILE))
    return written


def _views(
    artist: QuestionArtist, question: ToDraw, groups: dict[int, Ids]
) -> Sequence[tuple[str, UInt8[np.ndarray, "H W 3"]]]:
    found = []
    for place, row in enumerate(question.candidates):
        drawn = artist.view(question, row, groups)
        if drawn is not None:
            color = laid_over(drawn.color, [drawn.overlay] if drawn.overlay else [])
            found.append((f"view-{place}-cluster-{row['cluster']}-{row['move']}", color))
    return found


def _groundings(artist: QuestionArtist, question: ToDraw) -> Sequence[tuple[str, UInt8[np.ndarray, "H W 3"]]]:
    return [(f"grounded-{drawn.view}", laid_over(drawn.color, [drawn.overlay])) for drawn in artist.grounded(question)]
