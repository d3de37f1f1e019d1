"""SAM and CLIP end to end on models of a few thousand random weights: shapes, units and names, no meaning."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.construct.semantics.describe import CANONICAL, SemanticsConfig, describe
from pipeline.construct.semantics.labels_2d.clip_model import ClipModel
from pipeline.construct.semantics.labels_2d.sam_clip import SamClipConfig
from pipeline.construct.semantics.labels_2d.scene_frames import rendered_frames
from schemas.errors import InputError
from tests.construct.semantics.labels_2d.small_models import tokenizer_files
from tests.query.tiny import tiny_scene

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")

UNIT = 1e-5


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A CLIP whose tokenizer knows letters."""
    folder = tmp_path_factory.mktemp("clip")
    ends = {"bos_token_id": 52, "eos_token_id": 53, "pad_token_id": 53}
    small = {"hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 1, "num_attention_heads": 2}
    config = transformers.CLIPConfig(
        text_config={**small, **ends, "vocab_size": 57, "max_position_embeddings": 20},
        vision_config={**small, "image_size": 32, "patch_size": 8},
        projection_dim=8,
    )
    transformers.CLIPModel(config).save_pretrained(folder)
    images = transformers.CLIPImageProcessor(size={"shortest_edge": 32}, crop_size={"height": 32, "width": 32})
    words = transformers.CLIPTokenizer(*tokenizer_files(folder))
    transformers.CLIPProcessor(images, words).save_pretrained(folder)
    return str(folder)


@pytest.fixture(scope="module")
def sam(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("sam")
    config = transformers.SamConfig(
        vision_config=transformers.SamVisionConfig(
            hidden_size=32, output_channels=16, num_hidden_layers=1, num_attention_heads=2, image_size=64, patch_size=8,
            window_size=4, global_attn_indexes=[0], mlp_dim=32, num_pos_feats=8,
        ),
        prompt_encoder_config=transformers.SamPromptEncoderConfig(
            hidden_size=16, image_size=64, patch_size=8, mask_input_channels=4
        ),
        mask_decoder_config=transformers.SamMaskDecoderConfig(
            hidden_size=16, mlp_dim=32, num_hidden_layers=1, num_attention_heads=2, iou_head_hidden_dim=16
        ),
    )  # fmt: skip
    torch.manual_seed(0)
    model = transformers.SamModel(config)
    model.mask_decoder.iou_prediction_head.proj_out.bias.data.fill_(9.0)  # sure of whatever it proposes
    model.save_pretrained(folder)
    images = transformers.SamImageProcessor(
        size={"longest_edge": 64},
        pad_size={"height": 64, "width": 64},
        mask_size={"longest_edge": 16},
        mask_pad_size={"height": 16, "width": 16},
    )
    transformers.SamProcessor(images).save_pretrained(folder)
    return str(folder)


def test_both_sides_of_clip_give_unit_features(clip: str) -> None:
    model = ClipModel(clip)
    images = model.images([np.zeros((9, 9, 3), np.uint8), np.full((40, 40, 3), 200, np.uint8)])
    texts = model.encode(["chair", "a lamp"])
    assert images.shape == texts.shape == (2, model.dimension) == (2, 8)
    np.testing.assert_allclose(np.linalg.norm([*images, *texts], axis=1), 1, atol=UNIT)


def test_a_scene_gets_features_and_their_text_side(clip: str, sam: str) -> None:
    scene = tiny_scene()
    source = SamClipConfig(sam=sam, clip=clip, points=3, least_quality=0.0)
    frames = rendered_frames(scene.gaussians, scene.views[:2])
    found = describe(scene.gaussians, frames, SemanticsConfig(source=source, texts=("chair",)))
    embedding = found.semantics.embedding
    assert embedding is not None
    assert embedding.shape == (len(scene.gaussians), 8)
    assert found.report is not None
    assert found.report.labelled == (embedding != 0).any(axis=1).sum() > 0
    assert found.texts is not None
    assert found.texts.names == ("chair", *CANONICAL)
    assert found.texts.model == clip


def test_a_model_without_weights_of_its_own_is_refused(clip: str, sam: str) -> None:
    with pytest.raises(InputError, match=r"a model that CLIPModel loads, found no weights for \d+ parameters"):
        ClipModel(sam)
    with pytest.raises(InputError, match=r"a model that SamModel loads, found no weights for \d+ parameters"):
        SamClipConfig(sam=clip, clip=clip).open()
