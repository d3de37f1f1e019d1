"""The signs on a map: path, wedges of views, centres of clusters, and a strip below with scale and legend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from jobs.drawing.map_frame import MapFrame
from jobs.drawing.overlays import rgb_of

if TYPE_CHECKING:
    from PIL import ImageDraw

PAPER, INK, PATH, HALO = (255, 255, 255), (33, 37, 41), (73, 80, 87), (255, 255, 255)
WEDGE_RAD = 0.45
"""Half the angle of a view's wedge: a sign, not its field of view."""
FIRST_REACH, NOVEL_REACH = 6.0, 4.0
"""Length of a wedge, percent of the map's longer side."""
SIGNS = ("line: recorded cameras", "long wedge: initial view", "short wedge: novel view", "filled: chosen")

Entry = tuple[str, tuple[int, int, int] | None]
"""A text of the legend and the colour of its dot."""


class MapPen:
    """Draws in metres on a map.

    Args:
        frame: What the map shows.
        long_side: Pixels of its longer side.
    """

    def __init__(self, frame: MapFrame, long_side: int) -> None:
        from PIL import ImageFont

        self._frame, self._per_metre, self._unit = frame, frame.per_metre(long_side), long_side / 100.0
        self._font = ImageFont.load_default(1.5 * self._unit)

    def path(self, draw: ImageDraw.ImageDraw, places: Float[np.ndarray, "N 2"]) -> None:
        """Draw where the recorded cameras stand, in order; metres on the map."""
        points = self._pixels(places)
        for color, width in ((HALO, 0.45), (PATH, 0.2)):
            draw.line(points, color, round(width * self._unit), "curve")
        for point in points:
            draw.circle(point, 0.3 * self._unit, PATH)

    def wedge(self, draw: ImageDraw.ImageDraw, row: Mapping[str, Any]) -> None:
        """Draw where a candidate stands and looks: filled where it was chosen."""
        pose = np.array(row["world_to_camera"], np.float64).reshape(3, 4)
        (stand,) = self._pixels(self._frame.at((-pose[:, :3].T @ pose[:, 3])[None]))
        angle = float(np.arctan2(self._frame.down @ pose[2, :3], self._frame.right @ pose[2, :3]))
        reach = (FIRST_REACH if row["move"] == "initial" else NOVEL_REACH) * self._unit
        turns = (angle - WEDGE_RAD, angle + WEDGE_RAD)
        corners = [stand, *((stand[0] + reach * np.cos(turn), stand[1] + reach * np.sin(turn)) for turn in turns)]
        color = rgb_of(int(row["cluster"]))
        if row["chosen"]:
            draw.polygon(corners, color, INK, round(0.3 * self._unit))
            return
        for edge, width in ((HALO, 0.55), (color, 0.3)):
            draw.line([*corners, stand], edge, round(width * self._unit), "curve")

    def centre(self, draw: ImageDraw.ImageDraw, row: Mapping[str, Any]) -> None:
        """Draw a cluster's number at its centre."""
        (point,) = self._pixels(self._frame.at(np.array(row["centre"], np.float64)[None]))
        draw.circle(point, 1.5 * self._unit, rgb_of(int(row["cluster"])), HALO, round(0.35 * self._unit))
        draw.text(point, str(row["cluster"]), INK, self._font, "mm")

    def rows(self, clusters: Sequence[Mapping[str, Any]], width: int) -> list[list[tuple[float, Entry]]]:
        """Return the legend as rows of places and entries that fit into `width` pixels, beside and below the scale."""
        named: list[Entry] = [(f"{row['cluster']} {row['category']}", rgb_of(int(row["cluster"]))) for row in clusters]
        entries = [*named, *((sign, None) for sign in (SIGNS if clusters else SIGNS[:1]))]
        at = 4 * self._unit + self._per_metre
        rows: list[list[tuple[float, Entry]]] = [[]]
        for entry in entries:
            wide = self._font.getlength(entry[0]) + (4 if entry[1] else 2.5) * self._unit
            if at + wide > width and rows[-1]:
                rows.append([])
                at = self._unit
            rows[-1].append((at, entry))
            at += wide
        return rows

    def strip_height(self, rows: Sequence[Sequence[object]]) -> int:
        """Return the height of the strip with scale and legend, pixels."""
        return round((2.4 * len(rows) + 1.2) * self._unit)

    def strip(self, draw: ImageDraw.ImageDraw, rows: Sequence[Sequence[tuple[float, Entry]]], top: int) -> None:
        """Draw scale and legend below the map, which ends at pixel row `top`."""
        unit, middle = self._unit, top + 1.8 * self._unit
        left, right = unit, unit + self._per_metre
        bar = middle + 0.9 * unit
        for line in ([(left, bar), (right, bar)], *([(x, bar - unit), (x, bar + 0.3 * unit)] for x in (left, right))):
            draw.line(line, INK, round(0.3 * unit))
        draw.text(((left + right) / 2, middle - 0.3 * unit), "1 m", INK, self._font, "mm")
        for place, row in enumerate(rows):
            for at, (text, color) in row:
                level = middle + 2.4 * place * unit
                if color is not None:
                    draw.circle((at + 0.7 * unit, level), 0.7 * unit, color)
                draw.text((at + (2.0 if color else 0.0) * unit, level), text, INK, self._font, "lm")

    def _pixels(self, places: Float[np.ndarray, "n 2"]) -> list[tuple[float, float]]:
        return [(float(x), float(y)) for x, y in places * self._per_metre]
