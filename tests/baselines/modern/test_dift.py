"""DIFT with a small diffusion model of random weights, saved as the hub has it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines import Frame
from pliant.spec.errors import CallError
from pliant.spec.frame import Pair

diffusers = pytest.importorskip("diffusers")
transformers = pytest.importorskip("transformers")
torch = pytest.importorskip("torch")

pytestmark = pytest.mark.filterwarnings("ignore")  # the libraries' own


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    torch.manual_seed(0)
    root = tmp_path_factory.mktemp("diffusion")
    diffusers.UNet2DConditionModel(
        sample_size=16, block_out_channels=(8, 16), layers_per_block=1, norm_num_groups=4,
        down_block_types=("CrossAttnDownBlock2D", "DownBlock2D"),
        up_block_types=("UpBlock2D", "CrossAttnUpBlock2D"),
        cross_attention_dim=16, attention_head_dim=4,
    ).save_pretrained(root / "unet")  # fmt: skip
    diffusers.AutoencoderKL(
        block_out_channels=(8, 8, 8, 8), norm_num_groups=4,
        down_block_types=("DownEncoderBlock2D",) * 4, up_block_types=("UpDecoderBlock2D",) * 4,
    ).save_pretrained(root / "vae")  # fmt: skip
    diffusers.DDIMScheduler().save_pretrained(root / "scheduler")
    transformers.CLIPTextModel(
        transformers.CLIPTextConfig(
            vocab_size=8, hidden_size=16, intermediate_size=16, num_hidden_layers=1,
            num_attention_heads=2, max_position_embeddings=8, bos_token_id=0, eos_token_id=1,
            pad_token_id=1,
        )
    ).save_pretrained(root / "text_encoder")  # fmt: skip
    words = root / "tokenizer"
    words.mkdir()
    vocabulary = ["<|startoftext|>", "<|endoftext|>", "a", "a</w>", "r", "r</w>", "o", "o</w>"]
    (words / "vocab.json").write_text(json.dumps({each: i for i, each in enumerate(vocabulary)}))
    (words / "merges.txt").write_text("#version: 0.2\n")
    transformers.CLIPTokenizer(
        str(words / "vocab.json"), str(words / "merges.txt"), model_max_length=8
    ).save_pretrained(words)
    return str(root)


def picture(du: int = 0) -> Any:
    wide = np.random.default_rng(0).integers(0, 255, (16, 32, 3), np.uint8)
    wide = np.kron(wide, np.ones((8, 8, 1), np.uint8))  # (128, 256)
    return np.ascontiguousarray(wide[:, 64 - du : 192 - du])


def test_an_image_matches_itself(folder: str) -> None:
    method: Any = pliant.open_method(
        "dift", weights=folder, size=[128, 128], ensemble=2, timestep=1, block=1
    )
    queries = np.random.default_rng(1).uniform(16, 112, (40, 2)).astype(np.float32)
    found = method.answer(Pair(Frame(picture(), key="a"), Frame(picture(), key="b"), queries))
    # Eight random channels confuse some places; the others are found to a tenth of a pixel.
    assert (np.hypot(*(found.uv_px - queries).T) < 0.2).mean() > 0.3
    assert method.describe()["timestep"] == 1
    # A larger image is resized, and answers are in its own pixels.
    large = np.kron(picture(), np.ones((2, 2, 1), np.uint8))
    found = method.answer(Pair(Frame(large, key="c"), Frame(large, key="d"), 2 * queries))
    assert (np.hypot(*(found.uv_px - 2 * queries).T) < 0.4).mean() > 0.3


def test_what_cannot_be_asked(folder: str, tmp_path: Path) -> None:
    with pytest.raises(CallError, match="no such block; found 5; required: 0 to 1"):
        pliant.open_method("dift", weights=folder, block=5)
    with pytest.raises(CallError, match="too few draws"):
        pliant.open_method("dift", weights=folder, ensemble=0)
    with pytest.raises(CallError, match="UNet2DConditionModel cannot load this"):
        pliant.open_method("dift", weights=str(tmp_path))
