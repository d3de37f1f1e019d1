"""How masks are grouped: overlaps are thinned, small ones lie on top, crops are square and black outside the mask."""

from __future__ import annotations

import numpy as np

from pipeline.construct.semantics.labels_2d.sam_clip import crop, stacked, thinned


def square(top: int, left: int, side: int) -> np.ndarray:
    mask = np.zeros((20, 24), bool)
    mask[top : top + side, left : left + side] = True
    return mask


def test_the_weaker_of_two_like_masks_goes() -> None:
    masks = np.stack([square(0, 0, 10), square(0, 1, 10), square(10, 12, 8)])
    assert thinned(masks, np.array([0.8, 0.9, 0.1], np.float32), 0.7).tolist() == [1, 2]
    assert thinned(masks, np.array([0.8, 0.9, 0.1], np.float32), 0.9).tolist() == [1, 0, 2]


def test_a_part_of_a_thing_is_not_like_it() -> None:
    masks = np.stack([square(0, 0, 12), square(2, 2, 4)])
    assert sorted(thinned(masks, np.array([0.9, 0.8], np.float32), 0.7).tolist()) == [0, 1]


def test_no_mask_is_thinned_to_none() -> None:
    assert not len(thinned(np.zeros((0, 20, 24), bool), np.zeros(0, np.float32), 0.7))


def test_smaller_masks_lie_on_top() -> None:
    image = stacked(np.stack([square(2, 2, 4), square(0, 0, 12)]))
    assert image[3, 3] == 0
    assert image[0, 0] == 1
    assert image[19, 19] == -1


def test_crops_are_square_and_black_around_the_mask() -> None:
    image = np.full((20, 24, 3), 200, np.uint8)
    mask = np.zeros((20, 24), bool)
    mask[4:6, 5:13] = True
    mask[4, 5] = False
    part = crop(image, mask)
    assert part.shape == (8, 8, 3)
    assert (part[..., 0] == 200).sum() == mask.sum()
    assert not part[3, 0].any()
    assert (part[4] == 200).all()
