"""What stands in the room: splats, recorded cameras, and a question's clusters, views and grounded Gaussians.

Nodes are named by numbers: names from data could hold slashes, which mean something there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from jobs.drawing.overlays import rgb_of
from jobs.drawing.question import Ids, truth_mask
from jobs.drawing.to_draw import ToDraw
from jobs.viewer.splats import most_visible, splats_of
from pipeline.geometry import Camera
from pipeline.geometry.quaternion import rotations_to_quats
from pipeline.query.candidates import read_photo
from pipeline.query.visibility import fitted_to
from pipeline.scene.views import View
from pipeline.tasks.context import SceneContext

if TYPE_CHECKING:
    import viser

LAYERS = {
    "splats": "Splats",
    "cameras": "Recorded cameras",
    "clusters": "Clusters",
    "views": "Views of the question",
    "grounded": "Grounded Gaussians",
}
"""Node and label of what can be shown and hidden."""
MOST_CAMERAS = 300
"""Recorded cameras that are drawn, evenly spaced: more hide the room."""
THUMBNAIL = 160
"""Longest side of a photograph in a recorded camera, pixels."""
CAMERA_M, CHOSEN_M, NOVEL_M, LINE_M = 0.06, 0.12, 0.03, 0.003
"""Depth of the frustum of a recorded camera, a chosen view and another view, and width of their lines."""
RECORDED = (73, 80, 87)
RIGHT, TOO_MUCH, MISSED = (47, 158, 68), (232, 89, 12), (28, 126, 214)
"""Grounded and true; grounded and not true; true and not grounded."""
SWELL, SHADE = 1.5, 0.2
"""How much larger coloured Gaussians are than their originals, so that they cover them, and how much of the original's
colour stays."""


class Stage:
    """Keeps what is drawn of one scene.

    Args:
        server: Where it is drawn.
        context: The scene.
        most: Gaussians drawn at most.
    """

    def __init__(self, server: viser.ViserServer, context: SceneContext, most: int) -> None:
        self._server, self._context = server, context
        self._gaussians = context.scene.gaussians
        self.layers = {name: server.scene.add_frame(f"/{name}", show_axes=False) for name in LAYERS}
        """Nodes that are shown and hidden as a whole."""
        ids = most_visible(self._gaussians, most)
        self.shown = len(ids)
        """Gaussians drawn."""
        self._add_splats("/splats/all", ids)
        views = context.scene.views
        self.cameras: tuple[View, ...] = views[:: -(-len(views) // MOST_CAMERAS) or 1]
        """Recorded views drawn."""
        self.frustums = [
            self._frustum(f"/cameras/{place}", view.camera, CAMERA_M, RECORDED)
            for place, view in enumerate(self.cameras)
        ]
        """Their nodes."""
        self.candidates: dict[int, viser.CameraFrustumHandle] = {}
        """Nodes of the question's candidates, by their place among its rows."""
        self._of_question: list[Any] = []

    def photographs(self) -> Iterator[str]:
        """Put photographs into the recorded cameras, yielding each camera's name after it.

        Raises:
            InputError: A photograph cannot be read.
        """
        for view, frustum in zip(self.cameras, self.frustums, strict=True):
            if view.image is not None:
                fitted = fitted_to(view.camera, THUMBNAIL)
                frustum.image = read_photo(view.image, fitted.width, fitted.height)
                yield view.name

    def clear(self) -> None:
        """Take away what belongs to a question."""
        for node in self._of_question:
            node.remove()
        self._of_question.clear()
        self.candidates = {}

    def put(
        self,
        question: ToDraw,
        groups: Mapping[int, Ids],
        cameras: Mapping[int, tuple[Camera, UInt8[np.ndarray, "H W 3"]]],
    ) -> None:
        """Draw a question in place of the last one.

        Args:
            question: Its rows.
            groups: Gaussians of its clusters by number.
            cameras: Camera and picture of its candidates, by their place among the rows.
        """
        self.clear()
        for number, ids in groups.items():
            self._of_question.append(self._add_splats(f"/clusters/{number}", ids, rgb_of(number)))
        for row in question.clusters:
            label = self._server.scene.add_label(
                f"/clusters/label-{row['cluster']}", f"{row['cluster']} {row['category']}", position=row["centre"]
            )
            self._of_question.append(label)
        for place, (camera, picture) in cameras.items():
            row = question.candidates[place]
            size = CHOSEN_M if row["chosen"] else NOVEL_M
            color, filled = rgb_of(int(row["cluster"])), bool(row["chosen"])
            node = self._frustum(f"/views/{place}", camera, size, color, filled=filled, image=picture)
            self.candidates[place] = node
            self._of_question.append(node)
        for name, (mask, color) in self._groundings(question).items():
            if mask.any():
                self._of_question.append(self._add_splats(f"/grounded/{name}", np.flatnonzero(mask), color))

    def _groundings(self, question: ToDraw) -> dict[str, tuple[Bool[np.ndarray, "M"], tuple[int, int, int]]]:
        found = np.zeros(len(self._gaussians), bool)
        for row in question.regions:
            found[np.asarray(row["gaussians"], np.int64)] = True
        truth = truth_mask(self._context, question.targets)
        if truth is None or not question.regions:
            return {"found": (found, RIGHT)}
        true = truth[:-1]
        return {"right": (found & true, RIGHT), "more": (found & ~true, TOO_MUCH), "missed": (~found & true, MISSED)}

    def _add_splats(self, name: str, ids: Int[np.ndarray, "K"], color: tuple[int, int, int] | None = None) -> Any:
        splats = splats_of(self._gaussians, ids)
        colors, spread, opacities = splats.colors, splats.covariances, splats.opacities
        if color is not None:
            own: Float[np.ndarray, "3"] = np.array(color, np.float32) / 255
            colors = (SHADE * colors + (1 - SHADE) * own).astype(np.float32)
            spread, opacities = spread * np.float32(SWELL**2), 1 - (1 - opacities) ** 2
        return self._server.scene.add_gaussian_splats(name, splats.centers, spread, colors, opacities)

    def _frustum(
        self,
        name: str,
        camera: Camera,
        size: float,
        color: tuple[int, int, int],
        *,
        filled: bool = False,
        image: UInt8[np.ndarray, "H W 3"] | None = None,
    ) -> viser.CameraFrustumHandle:
        return self._server.scene.add_camera_frustum(
            name,
            fov=vertical_fov(camera),
            aspect=camera.width / camera.height,
            scale=size,
            thickness=LINE_M,
            color=color,
            image=image,
            wxyz=rotations_to_quats(camera.camera_to_world[:, :3]),
            position=camera.center,
            variant="filled" if filled else "wireframe",
            cast_shadow=False,
            receive_shadow=False,
        )


def vertical_fov(camera: Camera) -> float:
    """Return the vertical field of view, radians."""
    return float(2 * np.arctan(camera.height / (2 * camera.K[1, 1])))
