"""The controls beside the room: which question, which view, what is shown, and what the run said."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from jobs.drawing.overlays import COLORS, laid_over
from jobs.drawing.question import LARGE, Ids, QuestionArtist
from jobs.drawing.run_scene import Asked, RunScene
from jobs.drawing.to_draw import ToDraw
from jobs.viewer.stage import LAYERS, MISSED, RIGHT, TOO_MUCH, Stage, vertical_fov
from pipeline.geometry import Camera
from pipeline.query.candidates import read_photo
from pipeline.query.visibility import fitted_to
from pipeline.render import color_image, render
from pipeline.tasks.context import SceneContext
from schemas.errors import SplatReasonerError

if TYPE_CHECKING:
    import viser

NO_VIEW = "choose a view to stand in it"
NO_QUESTION = "no question"
LISTED = 70
"""Characters of a question in the list."""
AHEAD_M = 2.0
"""Distance of the point that dragging turns about."""
SMALL = 256
"""Longest side of the pictures in a question's views, pixels."""


@dataclass(frozen=True, slots=True)
class Place:
    """A view to stand in."""

    camera: Camera
    """Lens and pose."""
    picture: Callable[[], np.ndarray]
    """What is seen there: the photograph, or the render with what was found."""
    sign: viser.CameraFrustumHandle
    """Its node, which is hidden while one stands in it."""


class Panel:
    """The controls and what they do. One panel serves everybody who is connected; only cameras are each person's own.

    Args:
        server: Where it is shown.
        context: The scene.
        stage: What stands in the room.
        run: What a run says of the scene; None for the scene alone.
        question_id: The question to begin with; empty for none.
        dark: Whether it begins dark.
        threads: Threads a picture.
        tell: Told what goes wrong before anybody is connected.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        context: SceneContext,
        stage: Stage,
        run: RunScene | None,
        question_id: str,
        dark: bool,
        threads: int,
        tell: Callable[[str], None],
    ) -> None:
        self._server, self._context, self._stage, self._run = server, context, stage, run
        self._artist = QuestionArtist(context, None if run is None else run.method, threads)
        self._threads, self._tell = threads, tell
        # Callbacks come from several threads, and the context is for one.
        self._lock = threading.RLock()
        self._places: dict[str, Place] = {}
        self._hidden: viser.CameraFrustumHandle | None = None
        self._boxes: dict[str, viser.GuiCheckboxHandle] = {}
        gui = server.gui
        self._theme(dark)
        total = len(context.scene.gaussians)
        counted = f"{total:,} Gaussians" if stage.shown == total else f"{stage.shown:,} of {total:,} Gaussians drawn"
        views = f"{len(stage.cameras)} of {len(context.scene.views)} recorded views"
        gui.add_html(_lines(f"{counted}; {views}"))
        self._questions: dict[str, str] = {}
        if run is not None:
            self._questions = {_titled(asked): key for key, asked in run.questions.items()}
            titles = (NO_QUESTION, *self._questions)
            first = next((title for title, key in self._questions.items() if key == question_id), NO_QUESTION)
            pick = gui.add_dropdown("Question", titles, initial_value=first)
            pick.on_update(lambda event: self._guarded(event.client, lambda: self._choose(pick.value, event.client)))
        self._told = gui.add_html("")
        self._view = gui.add_dropdown("View", (NO_VIEW,))
        self._view.on_update(self._picked)
        step = gui.add_button_group("Step", ("Previous", "Next"))
        step.on_click(lambda event: self._guarded(event.client, lambda: self._step(step.value == "Next", event.client)))
        self._picture = gui.add_image(np.zeros((3, 4, 3), np.uint8), visible=False)
        with gui.add_folder("Layers"):
            for name, label in LAYERS.items():
                if name in ("splats", "cameras") or run is not None:
                    # A question's views are lost among hundreds of recorded ones.
                    self._switch(name, label, run is None or name != "cameras")
        if run is not None:
            gui.add_html(_legend())
        box = gui.add_checkbox("Dark", dark)
        box.on_update(lambda event: self._theme(box.value))
        self._guarded(None, lambda: self._choose(first if run is not None else NO_QUESTION, None))

    @property
    def start(self) -> Camera | None:
        """Where to stand at first: the first chosen view of the question, else the first recorded view."""
        return next((place.camera for place in self._places.values()), None)

    def _switch(self, name: str, label: str, shown: bool) -> None:
        box, layer = self._server.gui.add_checkbox(label, shown), self._stage.layers[name]
        layer.visible, self._boxes[name] = shown, box

        @box.on_update
        def _(event: Any) -> None:
            layer.visible = box.value

    def _theme(self, dark: bool) -> None:
        # The share button would publish the scene.
        self._server.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)

    def _choose(self, title: str, client: viser.ClientHandle | None) -> None:
        self._hide(None)
        self._places = {}
        asked, groups = None, dict[int, Ids]()
        if self._run is not None and title in self._questions:
            asked = self._run.questions[self._questions[title]]
            question = self._run.to_draw(asked.question_id)
            groups = self._artist.clusters(question)
            shots = {}
            for place, row in enumerate(question.candidates):
                camera = self._artist.camera(question, row)
                drawn = self._artist.view(question, row, groups, SMALL)
                if camera is not None and drawn is not None:
                    shots[place] = camera, laid_over(drawn.color, [drawn.overlay] if drawn.overlay else [])
            self._stage.put(question, groups, shots)
            # Both at once would mix their colours.
            _set(self._boxes["grounded"], bool(question.regions))
            _set(self._boxes["clusters"], not question.regions)
            for place in sorted(shots, key=lambda place: not question.candidates[place]["chosen"]):
                picture, sign = self._candidate(question, place, groups), self._stage.candidates[place]
                self._places[_named(question.candidates[place])] = Place(shots[place][0], picture, sign)
        else:
            self._stage.clear()
        for view, sign in zip(self._stage.cameras, self._stage.frustums, strict=True):
            picture = self._recorded(view.camera, view.image)
            self._places[f"recorded {view.name}"] = Place(view.camera, picture, sign)
        self._told.content = "" if asked is None else _told(asked, len(groups))
        self._view.options = (NO_VIEW, *self._places)
        _set(self._view, next(iter(self._places), NO_VIEW))
        self._stand(client)

    def _candidate(self, question: ToDraw, place: int, groups: dict[int, Ids]) -> Callable[[], np.ndarray]:
        def draw() -> np.ndarray:
            drawn = self._artist.view(question, question.candidates[place], groups)
            assert drawn is not None
            return laid_over(drawn.color, [drawn.overlay] if drawn.overlay else [])

        return draw

    def _recorded(self, camera: Camera, photo: str | None) -> Callable[[], np.ndarray]:
        def draw() -> np.ndarray:
            fitted = fitted_to(camera, LARGE)
            if photo is not None:
                return read_photo(photo, fitted.width, fitted.height)
            return color_image(render(self._context.gaussians, fitted, ("color",), threads=self._threads))

        return draw

    def _picked(self, event: Any) -> None:
        if event.client is not None:  # else it was set here, and what follows from it is done
            self._guarded(event.client, lambda: self._stand(event.client))

    def _stand(self, client: viser.ClientHandle | None) -> None:
        place = self._places.get(self._view.value)
        self._hide(place)
        self._picture.visible = False
        if place is None:
            return
        if client is not None:
            camera = place.camera
            with client.atomic():
                client.camera.up_direction = np.asarray(self._context.scene.up, np.float64)
                client.camera.position = camera.center
                client.camera.look_at = camera.center + AHEAD_M * camera.forward
                client.camera.fov = vertical_fov(camera)
        self._picture.image = place.picture()
        self._picture.visible = True

    def _hide(self, place: Place | None) -> None:
        """Hide the sign of the place that one stands in, which would fill the view, and show that of the last."""
        if self._hidden is not None:
            self._hidden.visible = True
        self._hidden = None if place is None else place.sign
        if self._hidden is not None:
            self._hidden.visible = False

    def _step(self, forward: bool, client: viser.ClientHandle | None) -> None:
        names = self._view.options
        _set(self._view, names[(names.index(self._view.value) + (1 if forward else -1)) % len(names)])
        self._stand(client)

    def _guarded(self, client: viser.ClientHandle | None, work: Callable[[], None]) -> None:
        """Do it, alone; an error is told to the person whose click it was."""
        with self._lock:
            try:
                work()
            except SplatReasonerError as error:
                if client is None:
                    self._tell(str(error))
                else:
                    client.add_notification("This did not work", str(error), color="red")


def _set(control: Any, value: object) -> None:
    """Set a control; the library's types say that it cannot be set."""
    control.value = value


def _titled(asked: Asked) -> str:
    text = asked.text if len(asked.text) <= LISTED else asked.text[: LISTED - 1] + "…"
    return f"{text} [{asked.question_id}]"


def _named(row: Any) -> str:
    chosen = ", chosen" if row["chosen"] else ""
    return f"cluster {row['cluster']} {row['move']}{chosen}: {row['candidate']}"


def _lines(*lines: str) -> str:
    return f'<div style="padding: 0.3em 0.8em; font-size: 0.9em; overflow-wrap: anywhere">{"<br>".join(lines)}</div>'


def _told(asked: Asked, clusters: int) -> str:
    said = asked.answer if asked.status == "answered" else f"{asked.status}: {asked.answer}"
    lines = [f"<b>{escape(asked.text)}</b>", f"{escape(asked.task)}: {escape(said)}"]
    if asked.reference:
        lines.append(f"ground truth: {escape(asked.reference)}")
    return _lines(*lines, f"{clusters} clusters found again")


def _legend() -> str:
    dots = "".join(_dot(color) for color in COLORS)
    grounded = ((RIGHT, "grounded, true or unknown"), (TOO_MUCH, "grounded, not true"), (MISSED, "true, not grounded"))
    parts = [f"{_dot('rgb' + str(color))} {text}" for color, text in grounded]
    return _lines(f"{dots} clusters 0, 1, 2 … and their views; large: chosen", *parts)


def _dot(color: str) -> str:
    return f'<span aria-hidden="true" style="color: {color}">&#9679;</span>'
