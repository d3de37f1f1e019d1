"""The part of an image that is rendered: a rectangle of whole tiles, in the pixels of the full image."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.geometry import Camera
from schemas.errors import InputError

TILE = 16
"""Pixels along the side of a tile."""
Tiles = tuple[int, int, int, int]
"""First column, first row, last column, last row of 16 x 16 tiles of the full image; the last ones are not part."""


@dataclass(frozen=True, slots=True)
class Window:
    """Pixels left to right and top to bottom of an image; right and bottom are not part."""

    left: int
    """First pixel column, a multiple of 16."""
    top: int
    """First pixel row, a multiple of 16."""
    right: int
    """The pixel column after the last: a multiple of 16, or the image's width."""
    bottom: int
    """The pixel row after the last: a multiple of 16, or the image's height."""

    @staticmethod
    def of(camera: Camera, tiles: Tiles | None = None) -> Window:
        """Return these tiles of the camera's image, cut at its edges; None for all of it.

        Raises:
            InputError: No tile of the image, or a tile beyond it.
        """
        columns, rows = -(-camera.width // TILE), -(-camera.height // TILE)
        first_column, first_row, last_column, last_row = (0, 0, columns, rows) if tiles is None else tiles
        if not (0 <= first_column < last_column <= columns and 0 <= first_row < last_row <= rows):
            expected = f"first < last within {columns} columns and {rows} rows of tiles"
            raise InputError("render", field="window", expected=expected, found=tiles)
        return Window(
            first_column * TILE,
            first_row * TILE,
            min(last_column * TILE, camera.width),
            min(last_row * TILE, camera.height),
        )

    @property
    def width(self) -> int:
        """Pixels in a row."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Rows of pixels."""
        return self.bottom - self.top

    @property
    def columns(self) -> int:
        """Tiles in a row."""
        return -(-self.width // TILE)

    @property
    def rows(self) -> int:
        """Rows of tiles."""
        return -(-self.height // TILE)

    @property
    def edges(self) -> Tiles:
        """Left, top, right, bottom: what kernels take."""
        return self.left, self.top, self.right, self.bottom

    def band(self, first_row: int, last_row: int) -> Window:
        """Return the rows of tiles first_row to last_row of this window, counted from its top."""
        return Window(self.left, self.top + first_row * TILE, self.right, min(self.top + last_row * TILE, self.bottom))
