"""Messages: what an image's hash covers, and that it holds once it was made."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from pipeline.models.messages import ImagePart, Message, Observation, text_of


def _image() -> ImagePart:
    seen = Observation(
        np.zeros((2, 3), np.int32), np.ones((2, 3), np.float32), np.eye(3), np.array([0.0, -1, 0]), ("a",)
    )
    return ImagePart(np.arange(18, dtype=np.uint8).reshape(2, 3, 3), seen)


def test_sha256_of_equal_images_is_equal_and_covers_every_array() -> None:
    assert _image().sha256() == _image().sha256()
    seen = _image().observation
    assert seen is not None
    others = [
        dataclasses.replace(seen, **{name: getattr(seen, name) + np.ones(1, getattr(seen, name).dtype)})
        for name in ("category", "depth", "K", "up")
    ]
    others.append(dataclasses.replace(seen, vocabulary=("b",)))
    images = [_image(), dataclasses.replace(_image(), color=np.zeros((2, 3, 3), np.uint8))]
    images += [ImagePart(_image().color, other) for other in (*others, None)]
    assert len({image.sha256() for image in images}) == len(images)


def test_sha256_is_made_once_and_nobody_writes_to_the_arrays_after(monkeypatch: pytest.MonkeyPatch) -> None:
    image = _image()
    first = image.sha256()
    monkeypatch.setattr("hashlib.sha256", None)

    assert image.sha256() == first
    with pytest.raises(ValueError, match="read-only"):
        image.color[0, 0] = 1


def test_sha256_of_a_view_of_memory_that_may_be_written_to_holds_for_a_copy() -> None:
    frames = np.zeros((2, 2, 3, 3), np.uint8)
    image = ImagePart(frames[0])
    first = image.sha256()
    frames[...] = 1

    assert not image.color.any()
    assert image.sha256() == first == ImagePart(np.zeros((2, 3, 3), np.uint8)).sha256()


def test_sha256_is_made_anew_for_an_image_that_was_pickled_or_replaced() -> None:
    image = _image()
    first = image.sha256()
    again = pickle.loads(pickle.dumps(image))
    other = dataclasses.replace(image, color=np.zeros((2, 3, 3), np.uint8))

    assert again.sha256() == first
    again = pickle.loads(pickle.dumps(image))
    again.color.flags.writeable = True
    again.color[0, 0] = 9
    assert first not in (again.sha256(), other.sha256())


def test_text_of_names_roles_and_stands_for_pictures_by_their_hash() -> None:
    image = _image()
    other = dataclasses.replace(image, color=image.color + np.uint8(1))
    system, user = Message("system", ("Be brief.\n", "Always.")), Message("user", ("Look.", "Image 0", image))
    said = text_of((system, user))
    shown = f"[image {image.sha256()[:16]}]"
    assert said == f"=== system ===\nBe brief.\nAlways.\n=== user ===\nLook.\nImage 0\n{shown}"
    assert said != text_of((system, Message("user", ("Look.", "Image 0", other))))
