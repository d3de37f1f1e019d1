from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.query.candidates import ImageConfig, PictureBook
from pipeline.query.visibility import VisibilityConfig, VisibilityIndex
from pipeline.render import prepare, render
from pipeline.scene.scene import Scene
from pipeline.scene.semantics import Semantics
from schemas.errors import InputError
from tests.query.tiny import UP, camera_at, tiny_scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene()


def _book(scene: Scene, **config: object) -> PictureBook:
    return PictureBook(scene, prepare(scene.gaussians), ImageConfig(**config))


def test_picture_holds_what_the_renderer_shows(scene: Scene) -> None:
    camera = scene.views[0].camera
    picture = _book(scene).render(camera)
    image = render(scene.gaussians, camera)
    observation = picture.image.observation
    assert observation is not None
    np.testing.assert_array_equal(picture.image.color, np.round(np.clip(image.color, 0, 1) * 255).astype(np.uint8))
    np.testing.assert_array_equal(observation.depth, image.depth)
    expected = np.where(image.dominant >= 0, scene.semantics.category[image.dominant], -1)
    np.testing.assert_array_equal(observation.category, expected)
    assert observation.vocabulary == scene.semantics.vocabulary
    assert picture.source == "render"


def test_observed_up_points_up_in_the_camera(scene: Scene) -> None:
    observation = _book(scene).render(camera_at((0, 0, 2), (0, 3, 0))).image.observation
    assert observation is not None
    np.testing.assert_allclose(np.linalg.norm(observation.up), 1)
    assert observation.up[1] < 0, "image y runs down"
    assert observation.up[2] < 0, "a camera that looks down has up behind its image plane"
    assert observation.up[0] == pytest.approx(0, abs=1e-12)


def test_visibility_equals_that_of_the_index_at_the_same_size(scene: Scene) -> None:
    index = VisibilityIndex(prepare(scene.gaussians), [view.camera for view in scene.views], VisibilityConfig())
    cluster = np.flatnonzero(scene.semantics.instance == 1).astype(np.int32)
    scores, book = index.counts([cluster]).scores[0], _book(scene)
    pictures = [book.render(view.camera) for view in scene.views]
    seen = [len(np.intersect1d(picture.footprint.ids, cluster)) / len(cluster) for picture in pictures]
    assert seen == scores.tolist()
    assert max(scores) > 0


def test_pictures_are_reduced_to_the_configured_side_with_their_lens(scene: Scene) -> None:
    picture = _book(scene, long_side=24).render(scene.views[0].camera)
    assert picture.image.color.shape == (18, 24, 3)
    assert picture.image.observation is not None
    np.testing.assert_allclose(picture.image.observation.K[:2] * 2, scene.views[0].camera.K[:2])


def test_equal_poses_are_rendered_once(scene: Scene) -> None:
    book = _book(scene)
    first = book.render(scene.views[0].camera)
    again = book.render(dataclasses.replace(scene.views[0].camera))
    assert again is first
    assert book.renders == 1
    book.render(scene.views[1].camera)
    assert book.renders == 2


def test_least_recently_used_pictures_are_dropped_at_the_limit(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    # A picture of 48 x 36 takes about 37 kB, so three fit; shrinking the unit saves making 50 of them.
    book = _book(scene, cache_mb=1)
    monkeypatch.setattr("pipeline.query.candidates.MEGABYTE", 130_000)
    cameras = [view.camera for view in scene.views[:4]]
    first = book.render(cameras[0])
    book.render(cameras[1])
    assert book.render(cameras[0]) is first
    book.render(cameras[2])
    book.render(cameras[3])
    assert book.render(cameras[0]) is first, "used again, so not the oldest"
    renders = book.renders
    book.render(cameras[1])
    assert book.renders == renders + 1, "the oldest was dropped"


def test_without_cache_pictures_are_equal_and_have_equal_keys(scene: Scene) -> None:
    book = _book(scene, cache_mb=0)
    first, again = (book.render(scene.views[0].camera) for _ in range(2))
    assert first is not again
    assert first.key == again.key
    assert first.image.sha256() == again.image.sha256()


def test_scene_without_labels_shows_no_observation(scene: Scene) -> None:
    features = np.ones((len(scene.gaussians), 2), np.float32)
    unlabelled = dataclasses.replace(scene, semantics=Semantics(("a",), embedding=features))
    assert _book(unlabelled).render(scene.views[0].camera).image.observation is None


class TestPhotographs:
    @staticmethod
    def _with_photo(scene: Scene, path: Path) -> Scene:
        return dataclasses.replace(scene, views=(dataclasses.replace(scene.views[0], image=str(path)),))

    def test_initial_view_shows_its_photograph_where_configured(self, scene: Scene, tmp_path: Path) -> None:
        pixels = np.zeros((72, 96, 3), np.uint8)
        pixels[..., 1] = 200
        Image.fromarray(pixels).save(tmp_path / "photo.png")
        with_photo = self._with_photo(scene, tmp_path / "photo.png")
        view = with_photo.views[0]
        shown = _book(with_photo, initial_image="photo").render(view.camera, view)
        assert shown.source == "photo"
        np.testing.assert_array_equal(shown.image.color, np.broadcast_to([0, 200, 0], (36, 48, 3)))
        rendered = _book(with_photo).render(view.camera, view)
        assert rendered.source == "render"
        assert shown.image.observation is not None
        assert rendered.image.observation is not None
        np.testing.assert_array_equal(shown.image.observation.depth, rendered.image.observation.depth)
        np.testing.assert_array_equal(shown.footprint.ids, rendered.footprint.ids)

    def test_novel_pose_is_rendered_even_where_photographs_are_shown(self, scene: Scene) -> None:
        assert _book(scene, initial_image="photo").render(scene.views[0].camera).source == "render"

    def test_view_without_photograph_is_rendered(self, scene: Scene) -> None:
        assert _book(scene, initial_image="photo").render(scene.views[0].camera, scene.views[0]).source == "render"

    @pytest.mark.parametrize("content", [b"no image", None])
    def test_broken_or_missing_photograph_is_named(self, scene: Scene, tmp_path: Path, content: bytes | None) -> None:
        if content is not None:
            (tmp_path / "photo.png").write_bytes(content)
        view = self._with_photo(scene, tmp_path / "photo.png").views[0]
        with pytest.raises(InputError, match=r"photo\.png"):
            _book(scene, initial_image="photo").render(view.camera, view)


def test_up_is_that_of_the_scene() -> None:
    assert tiny_scene().up.tolist() == UP.tolist()
