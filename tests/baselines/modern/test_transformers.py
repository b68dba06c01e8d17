"""Wrappers of `transformers`, with small networks of random weights saved as users have them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.baselines import Frame
from pliant.baselines.modern.dino import Dino
from pliant.baselines.modern.keypoints import KeypointMatching
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.frame import Pair

transformers = pytest.importorskip("transformers")
torch = pytest.importorskip("torch")

pytestmark = pytest.mark.filterwarnings("ignore")  # the library's own

LOFTR = {
    "hidden_size": 32, "num_attention_layers": 1, "num_attention_heads": 8,
    "stage_num_blocks": [1, 1, 1], "stage_stride": [2, 1, 2], "out_features": [16, 16, 32],
    "q_aggregation_kernel_size": 1, "kv_aggregation_kernel_size": 1,
    "q_aggregation_stride": 1, "kv_aggregation_stride": 1, "fine_kernel_size": 2,
    "coarse_matching_border_removal": 0, "coarse_matching_threshold": 0.0,
}  # fmt: skip
SUPERPOINT = {
    "encoder_hidden_sizes": [16, 16, 32, 32], "decoder_hidden_size": 32,
    "descriptor_decoder_dim": 32, "keypoint_threshold": 0.0, "max_keypoints": 64,
}  # fmt: skip


def picture(height: int, width: int, du: int = 0) -> Any:
    """Noise, moved to the right by `du` px."""
    wide = np.random.default_rng(0).integers(0, 255, (height, width + 64, 3), np.uint8)
    return np.ascontiguousarray(wide[:, 32 - du : 32 - du + width])


@pytest.fixture(scope="module", params=["lightglue", "efficientloftr"])
def matcher_folder(request: pytest.FixtureRequest, tmp_path_factory: Any) -> str:
    """A folder as the hub has it: config, weights and image processor."""
    torch.manual_seed(0)
    if request.param == "lightglue":
        detector = transformers.SuperPointConfig(**SUPERPOINT)
        config = transformers.LightGlueConfig(
            keypoint_detector_config=detector, descriptor_dim=32, num_hidden_layers=2,
            num_attention_heads=2, filter_threshold=0.0,
        )  # fmt: skip
        model = transformers.LightGlueForKeypointMatching(config)
        processor = transformers.LightGlueImageProcessorPil(size={"height": 96, "width": 128})
    else:
        model = transformers.EfficientLoFTRForKeypointMatching(
            transformers.EfficientLoFTRConfig(**LOFTR)
        )
        for weight in model.parameters():
            if weight.ndim > 1:
                torch.nn.init.normal_(weight, std=0.02)
        processor = transformers.EfficientLoFTRImageProcessorPil(size={"height": 96, "width": 128})
    folder = str(tmp_path_factory.mktemp(request.param))
    model.save_pretrained(folder)
    processor.save_pretrained(folder)
    return folder


def test_an_image_matches_itself(matcher_folder: str) -> None:
    """Identical images: a detector's keypoints are the same, and relative to the same pixels."""
    method = KeypointMatching(matcher_folder, threshold=0.0)
    image = picture(96, 128)
    found = method.match(Frame(image), Frame(image))
    assert len(found.score) > 0
    assert found.uv_a_px.dtype == np.float32
    off = np.linalg.norm(found.uv_a_px - found.uv_b_px, axis=1)
    assert np.median(off) < 4  # random networks: within a coarse cell
    larger = Frame(np.kron(image, np.ones((2, 2, 1), np.uint8)))
    scaled = method.match(larger, larger)
    # The processor halves the large image to the small one: every position doubles, exactly.
    np.testing.assert_allclose(
        np.sort(scaled.uv_a_px, axis=0), np.sort(2 * found.uv_a_px, axis=0), atol=1e-3
    )
    assert method.describe()["weights"] == matcher_folder


def test_keypoints_are_centres_of_pixels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The detector's index i of W columns is pixel (i + 0.5) W' / W of an image W' px wide."""
    config = transformers.LightGlueConfig(
        keypoint_detector_config=transformers.SuperPointConfig(**SUPERPOINT), descriptor_dim=32,
        num_hidden_layers=2, num_attention_heads=2,
    )  # fmt: skip
    transformers.LightGlueForKeypointMatching(config).save_pretrained(tmp_path)
    processor = transformers.LightGlueImageProcessorPil(size={"height": 96, "width": 128})
    processor.save_pretrained(tmp_path)
    method = KeypointMatching(str(tmp_path))
    index = torch.tensor([[[[8.0, 16.0], [40.0, 50.0]], [[40.0, 48.0], [9.0, 16.0]]]])

    class Said:
        keypoints = index / torch.tensor([128.0, 96.0])
        matches = torch.tensor([[[1, -1], [-1, 0]]])
        matching_scores = torch.tensor([[[0.9, 0.9], [0.9, 0.9]]])

    monkeypatch.setattr(type(method._model), "forward", lambda self, **inputs: Said)
    found = method.match(Frame(picture(96, 128)), Frame(picture(192, 256)))
    assert found.uv_a_px.tolist() == [[8.5, 16.5]]
    assert found.uv_b_px.tolist() == [[19.0, 33.0]]


def test_keypoint_matching_is_predicted(matcher_folder: str, tiny_dataset: Path) -> None:
    dataset = Dataset.open(tiny_dataset)
    method = pliant.open_method("keypoint-matching", weights=matcher_folder, threshold=0.0)
    pair = dataset.pairs("test")[0]
    answers = method.answer(  # type: ignore[union-attr]
        Pair(Frame(pair.source.rgb), Frame(pair.target.rgb), pair.queries)
    )
    assert answers.uv_px.shape == pair.queries.shape
    assert np.isfinite(answers.uv_px).all()


@pytest.fixture(scope="module", params=["dinov2", "dinov2-registers", "dinov3"])
def dino_folder(request: pytest.FixtureRequest, tmp_path_factory: Any) -> tuple[str, int]:
    """A folder and the patch size."""
    torch.manual_seed(1)
    small = {"hidden_size": 48, "num_hidden_layers": 2, "num_attention_heads": 3}
    if request.param == "dinov3":
        config = transformers.DINOv3ViTConfig(**small, intermediate_size=64, num_register_tokens=4)
        model: Any = transformers.DINOv3ViTModel(config)
    elif request.param == "dinov2":
        model = transformers.Dinov2Model(transformers.Dinov2Config(**small))
    else:
        config = transformers.Dinov2WithRegistersConfig(**small, num_register_tokens=4)
        model = transformers.Dinov2WithRegistersModel(config)
    folder = str(tmp_path_factory.mktemp(request.param))
    model.save_pretrained(folder)
    return folder, model.config.patch_size


@pytest.mark.parametrize("layer", [-1, 1])
def test_dino_finds_every_place_of_the_same_image(dino_folder: tuple[str, int], layer: int) -> None:
    folder, patch = dino_folder
    method = Dino(folder, layer=layer)
    view = Frame(picture(6 * patch - 3, 8 * patch, 0))
    features = method._features(method._images.image(view))
    assert features.shape == (6, 8, 48)  # rounded up to whole patches
    queries = np.random.default_rng(0).uniform(patch, 5 * patch - 3, (20, 2)).astype(np.float32)
    found = method.answer(Pair(view, view, queries))
    np.testing.assert_allclose(found.uv_px, queries, atol=0.05 * patch)
    assert found.modes is not None
    assert method.describe()["layer"] == layer


def test_dino_follows_a_shift_by_whole_patches(dino_folder: tuple[str, int]) -> None:
    """Content moves by two patches; random weights and positions, so most, not all, are found."""
    folder, patch = dino_folder
    torch.manual_seed(0)
    method = Dino(folder)
    if hasattr(method._model, "embeddings") and hasattr(
        method._model.embeddings, "position_embeddings"
    ):
        method._model.embeddings.position_embeddings.data.zero_()
    wide = np.random.default_rng(0).integers(0, 255, (5 * patch, 12 * patch, 3), np.uint8)
    source, target = Frame(wide[:, 2 * patch :]), Frame(wide[:, : 10 * patch])
    queries = np.random.default_rng(0).uniform(1.5, 3.5, (30, 2)).astype(np.float32) * patch
    found = method.answer(Pair(source, target, queries)).uv_px
    off = np.linalg.norm(found - queries - [2 * patch, 0], axis=1)
    assert np.median(off) < 0.35 * patch


def test_wrong_weights_are_one_sentence(tmp_path: Path, dino_folder: tuple[str, int]) -> None:
    with pytest.raises(CallError, match="AutoModel cannot load this"):
        Dino(str(tmp_path))
    with pytest.raises(CallError, match=r"size: this is not a size; found \[3\]"):
        Dino(dino_folder[0], size=[3])
    with pytest.raises(CallError, match="missing a required argument: 'weights'"):
        pliant.open_method("dino")
    transformers.SuperPointForKeypointDetection(
        transformers.SuperPointConfig(**SUPERPOINT)
    ).save_pretrained(tmp_path)
    with pytest.raises(CallError, match=r"cannot load this|has no patches"):
        Dino(str(tmp_path))
