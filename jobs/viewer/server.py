"""Opens a scene for browsers and ends it; the only file that loads viser."""

from __future__ import annotations

import errno
import io
import socket
import threading
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib.util import find_spec
from types import TracebackType

import numpy as np

from jobs.drawing.run_scene import RunScene
from jobs.viewer.panel import AHEAD_M, Panel
from jobs.viewer.stage import Stage, vertical_fov
from pipeline.scene.load import load_scene
from pipeline.tasks.context import SceneContext
from schemas.errors import InputError

MOST_GAUSSIANS = 1_000_000
"""Gaussians drawn at most: 32 MB to send, and about what a laptop's browser sorts smoothly."""


@dataclass(frozen=True, slots=True)
class ViewerOptions:
    """How a scene is shown."""

    host: str = "127.0.0.1"
    """Address to listen at. There is no password and every visitor steers the same panel: hence this machine alone."""
    port: int = 8080
    """Port; 0 takes a free one."""
    most: int = MOST_GAUSSIANS
    """Gaussians drawn at most, those that cover most."""
    dark: bool = False
    """Whether it begins dark."""
    threads: int = 1
    """Threads a picture."""


class Viewer:
    """A scene that is open for browsers, until it is left as a context manager.

    Args:
        scene_uri: Scene folder.
        run: Run folder over that scene; empty for the scene alone.
        question_id: The question to begin with; empty for none.
        options: How it is shown.
        tell: Told what is wrong and does not stop it, such as a photograph that cannot be read.

    Raises:
        InputError: viser is not installed, the port is in use, the scene is wrong, or the run has no such question.
    """

    def __init__(
        self,
        scene_uri: str,
        *,
        run: str = "",
        question_id: str = "",
        options: ViewerOptions,
        tell: Callable[[str], None] = print,
    ) -> None:
        if find_spec("viser") is None:
            raise InputError("view", expected="the extra 'view' (pip install 'splatreasoner[view]')", found="no viser")
        port = free_port(options.host, options.port)
        asked = RunScene(run, scene_uri) if run else None
        if asked is not None and question_id:
            asked.to_draw(question_id)
        context = SceneContext(load_scene(scene_uri))
        with redirect_stdout(io.StringIO()):
            self._server = _server_class()(host=options.host, port=port, label=context.scene.name, verbose=False)
        try:
            self.port = self._server.get_port()
            """Port it listens at."""
            if self.port != port:  # taken since it was looked at: viser goes on to the next one
                raise _in_use(options.host, port)
            self._server.scene.set_up_direction(np.asarray(context.scene.up, np.float64))
            stage = Stage(self._server, context, options.most)
            panel = Panel(self._server, context, stage, asked, question_id, options.dark, options.threads, tell)
            self._look_from(panel, context)
        except BaseException:
            self.close()
            raise
        host = "localhost" if options.host in ("127.0.0.1", "0.0.0.0", "::") else options.host
        self.url = f"http://{host}:{self.port}"
        """Where a browser finds it."""
        self._closed = threading.Event()
        self._photographs = threading.Thread(target=self._load_photographs, args=(stage, tell), daemon=True)
        self._photographs.start()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._closed.set()
        self._photographs.join()
        self.close()

    def close(self) -> None:
        """End it; browsers are told."""
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    def _look_from(self, panel: Panel, context: SceneContext) -> None:
        camera, first = panel.start, self._server.initial_camera
        if camera is not None:
            first.position, first.look_at = camera.center, camera.center + AHEAD_M * camera.forward
            first.up, first.fov = np.asarray(context.scene.up, np.float64), vertical_fov(camera)

    def _load_photographs(self, stage: Stage, tell: Callable[[str], None]) -> None:
        try:
            for _ in stage.photographs():
                if self._closed.is_set():
                    return
        except InputError as error:
            tell(f"no more photographs: {error}")


def free_port(host: str, port: int) -> int:
    """Return a port that nobody listens at.

    Raises:
        InputError: The port is in use, or the host is none of this machine's.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
            return int(probe.getsockname()[1])
    except socket.gaierror as error:
        raise InputError("--host", expected="an address of this machine", found=host) from error
    except PermissionError as error:
        raise InputError("--port", expected="a port that you may open", found=port) from error
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise _in_use(host, port) from error
        raise InputError("--host", expected="an address of this machine", found=f"{host}: {error.strerror}") from error


def _in_use(host: str, port: int) -> InputError:
    return InputError("--port", expected="a free port, or 0 for any", found=f"{port}, which is in use at {host}")


def _server_class() -> type:
    import viser

    class LocalServer(viser.ViserServer):
        """A server that refuses to publish the scene, which any visitor could ask for."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            return None

    return LocalServer
