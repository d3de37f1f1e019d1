"""Open-set features: SAM's masks, each described by CLIP, grouped by size as LangSplat and Dr. Splat do.

Both models come from the transformers library by local folder or hub name. SAM proposes masks at a grid of points;
proposals that overlap are thinned, the rest go to a level by size, and in a level the smaller mask lies on top. Dr.
Splat registers the largest level alone. CLIP sees each mask's crop, padded to a square, with all else black.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8
from pydantic import BaseModel, ConfigDict, Field

from pipeline.construct.semantics.labels_2d.clip_model import ClipModel
from pipeline.construct.semantics.labels_2d.source import FrameFeatures
from pipeline.construct.semantics.labels_2d.torch_models import load_pretrained, require
from pipeline.scene.captures import Frame
from pipeline.scene.semantics import UNLABELLED

Level = Literal["small", "medium", "large"]
SAM = "facebook/sam-vit-huge"
CLIP = "laion/CLIP-ViT-B-16-laion2B-s34B-b88K"
MASKS_AT_ONCE = 32
"""Crops CLIP sees in one batch: 60 MB at 224 pixels with what it computes on the way."""

COMPARED = 20_000
"""Pixels, about, at which overlaps are measured: 80 MB for SAM's thousand proposals."""


class SamClipConfig(BaseModel):
    """The two models and the grouping; defaults are Dr. Splat's."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["sam_clip"] = "sam_clip"
    sam: str = Field(default=SAM, description="Local folder or hub name of a SAM model.")
    clip: str = Field(default=CLIP, description="Local folder or hub name of a CLIP model, text side included.")
    device: str = Field(default="cpu", description="Torch device.")
    points: int = Field(default=32, ge=2, le=128, description="Points along each side of SAM's grid.")
    level: Level = Field(
        default="large",
        description="Which of SAM's three masks a point counts: its whole (Dr. Splat), part or subpart.",
    )
    least_quality: float = Field(default=0.7, ge=0, le=1, description="SAM's own estimate of a mask's IoU.")
    overlap: float = Field(default=0.7, gt=0, le=1, description="IoU over which the weaker of two masks is dropped.")
    least_share: float = Field(default=1e-4, gt=0, lt=1, description="Masks under this share of the image are dropped.")

    def open(self, scene: str = "") -> SamClip:
        """Return the source, models loaded; the scene's name is not needed.

        Raises:
            InputError: A library is missing, or a model cannot be loaded.
        """
        return SamClip(self)


class SamClip:
    """Masks and their features by SAM and CLIP."""

    def __init__(self, config: SamClipConfig) -> None:
        self.config = config
        self._sam: Any = load_pretrained("SamModel", config.sam).to(config.device).eval()
        self._looks: Any = load_pretrained("SamProcessor", config.sam)
        self.clip = ClipModel(config.clip, config.device)
        self.dimension = self.clip.dimension
        self.description = f"{config.sam} {config.level} masks, {config.clip}"

    def features(self, frame: Frame) -> FrameFeatures:
        """Return the masks of a frame and CLIP's feature of each.

        Raises:
            InputError: The frame has no photograph.
        """
        image = frame.read_image()
        masks, quality = self._proposals(image)
        large_enough = masks.mean(axis=(1, 2)) >= self.config.least_share if len(masks) else np.zeros(0, bool)
        masks = masks[large_enough]
        masks = masks[thinned(masks, quality[large_enough], self.config.overlap)]
        if not len(masks):
            return FrameFeatures(
                np.full(image.shape[:2], UNLABELLED, np.int32), np.zeros((0, self.dimension), np.float32)
            )
        rows = [
            self.clip.images([crop(image, mask) for mask in masks[start : start + MASKS_AT_ONCE]])
            for start in range(0, len(masks), MASKS_AT_ONCE)
        ]
        return FrameFeatures(stacked(masks), np.concatenate(rows))

    def _proposals(
        self, image: UInt8[np.ndarray, "H W 3"]
    ) -> tuple[Bool[np.ndarray, "K H W"], Float32[np.ndarray, "K"]]:
        """Return SAM's mask of the wanted level at each grid point that it is sure of, and how sure."""
        torch = require("torch")
        height, width = image.shape[:2]
        steps = (np.arange(self.config.points) + 0.5) / self.config.points
        grid = np.stack(np.meshgrid(steps * width, steps * height), axis=-1).reshape(-1, 1, 2)
        level = ("small", "medium", "large").index(self.config.level)
        masks, quality = [], []
        with torch.inference_mode():
            inputs = self._looks(image, return_tensors="pt").to(self.config.device)
            seen = self._sam.get_image_embeddings(inputs["pixel_values"])
            sizes = inputs["original_sizes"].cpu(), inputs["reshaped_input_sizes"].cpu()
            for start in range(0, len(grid), 64):
                points = self._looks(image, input_points=[grid[start : start + 64].tolist()], return_tensors="pt")
                out = self._sam(
                    image_embeddings=seen,
                    input_points=points["input_points"].float().to(self.config.device),
                    multimask_output=True,
                )
                scores = out.iou_scores[0, :, level].float().cpu().numpy()
                sure = scores >= self.config.least_quality
                whole = self._looks.image_processor.post_process_masks(out.pred_masks.cpu(), *sizes)[0]
                masks.append(whole[:, level].numpy()[sure])
                quality.append(scores[sure])
        return np.concatenate(masks).astype(bool), np.concatenate(quality).astype(np.float32)


def thinned(
    masks: Bool[np.ndarray, "K H W"], quality: Float32[np.ndarray, "K"], overlap: float
) -> Int32[np.ndarray, "k"]:
    """Return the masks to keep, best first: none overlaps a better one by more than an IoU of `overlap`."""
    order = np.argsort(-quality, kind="stable")
    if not len(masks):
        return np.zeros(0, np.int32)
    step = max(1, int(np.sqrt(masks[0].size / COMPARED)))
    flat = masks[:, step // 2 :: step, step // 2 :: step].reshape(len(masks), -1).astype(np.float32)
    shared = flat @ flat.T
    areas = np.diag(shared)
    iou = shared / np.maximum(areas[:, None] + areas[None, :] - shared, 1.0)
    kept: list[int] = []
    for one in order.tolist():
        if (iou[one, kept] <= overlap).all():
            kept.append(one)
    return np.array(kept, np.int32)


def stacked(masks: Bool[np.ndarray, "K H W"]) -> Int32[np.ndarray, "H W"]:
    """Return the mask on top at each pixel, the smaller of two that overlap; -1 for none."""
    image = np.full(masks.shape[1:], UNLABELLED, np.int32)
    areas = masks.sum(axis=(1, 2))
    for one in np.argsort(-areas, kind="stable").tolist():
        image[masks[one]] = one
    return image


def crop(image: UInt8[np.ndarray, "H W 3"], mask: Bool[np.ndarray, "H W"]) -> UInt8[np.ndarray, "s s 3"]:
    """Return the mask's box, black outside the mask, in the middle of a black square."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    part = np.where(mask[box][..., None], image[box], np.uint8(0))
    height, width = part.shape[:2]
    side = max(height, width)
    square = np.zeros((side, side, 3), np.uint8)
    top, left = (side - height) // 2, (side - width) // 2
    square[top : top + height, left : left + width] = part
    return square
