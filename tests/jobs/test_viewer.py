"""The viewer as people meet it: visited over a websocket and in Chromium, ended by a signal, refused with a reason."""

from __future__ import annotations

import base64
import io
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from jobs.viewer.panel import NO_VIEW
from jobs.viewer.server import Viewer, ViewerOptions, free_port
from jobs.viewer.splats import most_visible, splats_of
from jobs.viewer.stage import MISSED, RIGHT, TOO_MUCH
from pipeline.geometry.covariance import covariances
from pipeline.scene.load import load_scene
from schemas.errors import InputError
from tests.conftest import ROOT
from tests.jobs.blobs import EACH, PHOTO, save_balls
from tests.jobs.browser import Tab, browse, find_browser
from tests.jobs.visitor import Visitor, visit

SPLAT_BYTES = 32
"""Bytes a Gaussian on the wire."""
FREE = ViewerOptions(port=0)


@pytest.fixture(scope="module")
def viewer(balls: Path, balls_run: str) -> Iterator[Viewer]:
    pytest.importorskip("viser", reason="the extra 'view' is not installed")
    with Viewer(str(balls), run=balls_run, question_id="one/ball", options=FREE) as opened:
        yield opened


@pytest.fixture
def visitor(viewer: Viewer) -> Iterator[Visitor]:
    with visit(viewer.port) as one:
        yield one


def test_most_visible_keeps_the_large_and_opaque_in_order(balls: Path) -> None:
    scene = load_scene(str(balls)).gaussians
    logits, scales = scene.opacity_logits.copy(), scene.log_scales.copy()
    logits[:10], scales[70:] = -8.0, -9.0
    changed = type(scene)(scene.means, scene.quats, scales, logits, scene.sh)
    np.testing.assert_array_equal(most_visible(changed, 60), np.arange(10, 70))
    np.testing.assert_array_equal(most_visible(changed, 80), np.arange(80))
    np.testing.assert_array_equal(most_visible(scene, 3), [0, 1, 2])


def test_splats_of_are_what_the_renderer_draws(balls: Path) -> None:
    scene = load_scene(str(balls)).gaussians
    ids = np.array([5, 50])
    found = splats_of(scene, ids)
    np.testing.assert_allclose(found.covariances, covariances(scene.quats, scene.log_scales)[ids], rtol=1e-6)
    np.testing.assert_allclose(found.opacities[:, 0], 1 / (1 + np.exp(-4.0)), rtol=1e-6)
    np.testing.assert_allclose(found.colors, np.clip(0.5 + 0.28209479 * scene.sh[ids, 0], 0, 1), rtol=1e-6)


def _node(name: str) -> Any:
    return lambda message: message.get("name") == name


def test_visitor_is_sent_the_splats_and_what_the_question_found(visitor: Visitor, balls: Path) -> None:
    sent = visitor.until(_node("/splats/all"))["props"]["buffer"]
    assert len(sent) == 2 * EACH * SPLAT_BYTES
    means = np.frombuffer(sent, np.float32).reshape(-1, 8)[:, :3]
    np.testing.assert_array_equal(means, load_scene(str(balls)).gaussians.means)
    assert visitor.until(_node("/cameras/0"))["type"] == "CameraFrustumMessage"
    for number in (0, 1):
        assert len(visitor.until(_node(f"/clusters/{number}"))["props"]["buffer"]) == EACH * SPLAT_BYTES
    assert visitor.until(_node("/views/0"))["props"]["_image_data"]
    sizes = {m["name"]: len(m["props"]["buffer"]) for m in visitor.messages if "buffer" in m.get("props", {})}
    target = [sizes.get(f"/grounded/{name}", 0) for name in ("right", "missed")]
    assert sum(target) == EACH * SPLAT_BYTES, "found and missed together are the target"
    assert len({RIGHT, TOO_MUCH, MISSED}) == 3


def test_visitor_sees_the_photograph_in_its_camera(visitor: Visitor) -> None:
    found = visitor.until(lambda m: m.get("name") == "/cameras/0" and m.get("updates", {}).get("_image_data"))
    photo = np.asarray(Image.open(io.BytesIO(found["updates"]["_image_data"])))
    assert photo.shape == (48, 64, 3)
    np.testing.assert_allclose(photo[24, 32], PHOTO, atol=4)


def test_viewer_photograph_that_is_none_is_told_and_the_rest_is_shown(tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="the extra 'view' is not installed")
    scene, told = save_balls(tmp_path), list[str]()
    (scene / "images" / "front.png").write_bytes(b"no picture")
    with Viewer(str(scene), options=FREE, tell=told.append) as opened, visit(opened.port) as visitor:
        assert visitor.until(_node("/splats/all"))
        view = visitor.control("View")
        visitor.set(view, NO_VIEW)
        visitor.set(view, "recorded front")
        assert visitor.until(lambda m: m["type"] == "NotificationShowMessage" and "front.png" in str(m))
    assert told
    assert all("front.png: expected an image file" in text for text in told)


def test_visitor_text_of_the_question_is_escaped(visitor: Visitor) -> None:
    shown = [m["updates"]["content"] for m in visitor.messages if "content" in m.get("updates", {})]
    shown += [m["props"]["content"] for m in visitor.messages if "content" in m.get("props", {})]
    assert any("This is the ball." in text for text in shown)
    assert not any("<img" in text for text in shown)


def test_visitor_who_chooses_a_view_is_moved_there(visitor: Visitor) -> None:
    view = visitor.control("View")
    visitor.set(view, "recorded front")
    found = visitor.until(lambda message: message["type"] == "SetCameraPositionMessage")
    np.testing.assert_allclose(found["position"], (0, -3, 0), atol=1e-6)
    ahead = visitor.until(lambda message: message["type"] == "SetCameraLookAtMessage" and message["look_at"][1] > -2)
    np.testing.assert_allclose(ahead["look_at"], (0, -1, 0), atol=1e-6)
    fov = visitor.until(lambda message: message["type"] == "SetCameraFovMessage")
    np.testing.assert_allclose(fov["fov"], 2 * np.arctan(24 / 60), rtol=1e-6)


def test_visitor_layers_and_questions_are_switched(visitor: Visitor) -> None:
    visitor.set(visitor.control("Splats"), False)
    hidden = visitor.until(lambda m: m["type"] == "SetSceneNodeVisibilityMessage" and m["name"] == "/splats")
    assert hidden["visible"] is False
    with visit_again(visitor) as other:
        question = other.control("Question")
        title = next(title for title in question["props"]["options"] if "How many" in title)
        other.set(question, title)
        removed = other.until(lambda m: m["type"] == "RemoveSceneNodeMessage" and "grounded" in m["name"])
        assert removed["name"].startswith("/grounded/")
        other.set(question, next(title for title in question["props"]["options"] if "This is" in title))
        assert other.until(_node("/clusters/1"))


def visit_again(visitor: Visitor) -> Any:
    return visit(visitor.socket.remote_address[1])


@pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine")
def test_chromium_shows_the_balls_and_asks_nothing_of_the_network(viewer: Viewer, tmp_path: Path) -> None:
    async def work(tab: Tab) -> np.ndarray:
        await tab.send("Emulation.setDeviceMetricsOverride", width=320, height=240, deviceScaleFactor=1, mobile=False)
        await tab.open(f"http://127.0.0.1:{viewer.port}", "document.querySelector('canvas')")
        await tab.until("document.body.innerText.includes('This is the ball.')")
        assert await tab.run("document.title") != "owned"
        shot = await tab.send("Page.captureScreenshot", format="png")
        outside = [
            uri for uri in tab.requests() if not uri.startswith((f"http://127.0.0.1:{viewer.port}", "data:", "blob:"))
        ]
        assert [uri for uri in outside if not uri.startswith("about:")] == []
        thrown = [event for event in tab.told if event["method"] == "Runtime.exceptionThrown"]
        assert thrown == []
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(shot["data"]))))

    assert browse(tmp_path, work).std() > 1


def test_viewer_port_in_use_is_named_and_nothing_is_opened(balls: Path) -> None:
    pytest.importorskip("viser", reason="the extra 'view' is not installed")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"--port: expected a free port, or 0 for any, found {port}"):
            Viewer(str(balls), options=ViewerOptions(port=port))


def test_free_port_foreign_address_is_an_input_error() -> None:
    with pytest.raises(InputError, match="--host"):
        free_port("203.0.113.1", 0)


def test_viewer_without_the_extra_names_it(balls: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jobs.viewer.server.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"the extra 'view' \(pip install 'splatreasoner\[view\]'\), found no viser"):
        Viewer(str(balls), options=FREE)


def test_view_ends_cleanly_on_ctrl_c(balls: Path) -> None:
    pytest.importorskip("viser", reason="the extra 'view' is not installed")
    command = [sys.executable, "-c", "from jobs.cli import main; main()", "view", str(balls), "--port", "0"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        port = int(first.split()[0].rsplit(":", 1)[1])
        with visit(port):
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=30)
    assert first.startswith("http://localhost:")
    assert (process.returncode, out, err) == (0, "ended\n", "")
