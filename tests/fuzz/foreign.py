"""Readers of what is not a dataset: import formats, settings, checkpoints, reports, receipts."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import torch
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from PIL import Image
from safetensors.torch import save

from pliant.baselines.answers_file import submission_of_file
from pliant.benchmarks.suite.config_file import read_config
from pliant.converters.annotations import read_rows
from pliant.converters.formats import read_source
from pliant.converters.knots import KNOTS_JSON, read_knots
from pliant.converters.tapvid import read_npz
from pliant.evaluator import evaluate, write_report
from pliant.evaluator.scores import SCORES_JSON, read_scores
from pliant.generator.config import GenerateConfig
from pliant.models.don.settings import DonSettings
from pliant.models.recipe_file import read_recipe
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.models.training.checkpoint import read_checkpoint, read_weights_file
from pliant.models.training.run_folder import read_run_json
from pliant.service.receipts import Signer, read_public_key, verify_receipt
from pliant.service.settings import read_challenge_settings
from pliant.spec.configuration import read_settings, settings_from
from pliant.spec.io import photo
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.secrets import SECRET_SEED_FILE, read_secret_seed
from tests.fuzz.reader import ROOT, TINY, Reader, files, in_folder, texts, tiny

_SIZE: Final = (6, 4)
_KEY: Final = Ed25519PrivateKey.from_private_bytes(bytes(32))


def _npz() -> list[bytes]:
    arrays = {
        "video": np.zeros((2, 4, 6, 3), np.uint8),
        "points": np.full((1, 2, 2), 0.5, np.float32),
        "occluded": np.zeros((1, 2), bool),
    }
    packed, plain = io.BytesIO(), io.BytesIO()
    np.savez_compressed(packed, **arrays)  # type: ignore[arg-type]
    np.savez(plain, **arrays)  # type: ignore[arg-type]
    empty = io.BytesIO()
    zipfile.ZipFile(empty, "w").close()
    return [packed.getvalue(), plain.getvalue(), empty.getvalue()]


def _pictures() -> list[bytes]:
    found = []
    for kind, mode in (("PNG", "I;16"), ("TIFF", "I;16"), ("GIF", "L"), ("WEBP", "RGB")):
        stream = io.BytesIO()
        Image.new(mode, _SIZE, 20 if mode != "RGB" else (20, 0, 0)).save(stream, kind)
        found.append(stream.getvalue())
    return found


def _npy() -> list[bytes]:
    stream = io.BytesIO()
    np.save(stream, np.ones(_SIZE[::-1], np.float32))
    return [stream.getvalue()]


def _answers(path: Path) -> object:
    out = path.with_name("answers.out.parquet")
    return submission_of_file(path, tiny(), "test", out, name="fuzzed", allow_missing=True)


def _weights() -> bytes:
    return save({"a": torch.zeros(2, 2), "b.c": torch.ones(3, dtype=torch.int64)})


def _checkpoint(path: Path) -> object:
    folder = in_folder(path, "state.json")
    for name in ("weights", "average", "optimiser"):
        (folder / f"{name}.safetensors").write_bytes(_weights())
    return read_checkpoint(folder)


@cache
def _report() -> tuple[tempfile.TemporaryDirectory[str], Path]:
    place = tempfile.TemporaryDirectory(prefix="pliant-fuzz-")
    folder = Path(place.name) / "report"
    write_report(evaluate(TINY / "submission.parquet", TINY / "dataset"), folder)
    return place, folder


def _receipt(path: Path) -> None:
    verify_receipt(read_json(path), _KEY.public_key())


def _receipts() -> list[bytes]:
    receipt = Signer(_KEY).sign({"file_sha256": "0" * 64, "scores": {"rmse_px": 1.5}})
    return [json.dumps(receipt).encode()]


def _public_key() -> list[bytes]:
    form = PublicFormat.SubjectPublicKeyInfo
    return [_KEY.public_key().public_bytes(Encoding.PEM, form)]


def _overrides(path: Path) -> object:
    lines = path.read_text("utf-8", "replace").split("\n")
    return settings_from(GenerateConfig, {}, overrides=lines)


_COCO: Final = json.dumps(
    {
        "images": [{"id": 1, "file_name": "a.png", "width": 6, "height": 4}],
        "categories": [{"id": 1, "name": "rope", "keypoints": ["end"]}],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "keypoints": [1, 2, 2]}],
    }
)
_LABELME: Final = json.dumps(
    {
        "version": "5.0",
        "imagePath": "a.png",
        "imageWidth": 6,
        "imageHeight": 4,
        "shapes": [{"label": "end", "shape_type": "point", "points": [[1.0, 2.0]], "flags": {}}],
    }
)
_STATE: Final = json.dumps(
    {
        "step": 3,
        "best": None,
        "history": [{"step": 1, "loss": 0.5}],
        "optimiser": {"state": {"0": {"step": {"tensor": "a"}}}, "param_groups": [{"lr": 0.1}]},
    }
)
_CONFIGS: Final = texts(
    "tiers: [rope]\nseed: 3\nrope: {length_m: [1.1, 1.6], ball: false}\n",
    "width: 160\nsteps: 10\npairs: {views: 4, input: grey}\naugment: &a {scale: 0.1}\n",
)
_CHALLENGE: Final = (
    "title: Ropes\nauthors: [Ada]\nsubmissions_per_minute: 4\nphases:\n"
    "- {name: test, split: test, protocol: standard}\nscoring: {wall_s: 60}\n"
)
_TABLE: Final = "pair_id,query_id,u,v,visible,sigma\n0,0,1.5,2.5,0.9,1\n0,1,3,4,1,2\n"

FOREIGN: Final[dict[str, Reader]] = {
    "generate-config": Reader(lambda path: read_settings(GenerateConfig, path), _CONFIGS, ".yaml"),
    "train-config": Reader(lambda path: read_settings(DonSettings, path), _CONFIGS, ".yaml"),
    "timecycle-config": Reader(
        lambda path: read_settings(TimeCycleSettings, path),
        files(ROOT / "models" / "configs", "timecycle.yaml"),
        ".yaml",
    ),
    "overrides": Reader(_overrides, texts("seed=3\nrope.length_m=[1.1, 1.6]\ntiers=[cloth-1]")),
    "model-recipe": Reader(
        read_recipe, files(ROOT / "models" / "configs" / "models", "*.yaml"), ".yaml"
    ),
    "benchmark-config": Reader(
        read_config, files(ROOT / "benchmarks" / "suite", "demo.yaml"), ".yaml"
    ),
    "challenge-config": Reader(read_challenge_settings, texts(_CHALLENGE), ".yaml"),
    "marks-csv": Reader(
        read_source, texts("picture,point,x,y,visible\na.png,end,1.5,2.5,1\n"), ".csv"
    ),
    "pairs-csv": Reader(
        lambda path: read_rows(path, ("source", "target")), texts("source,target\na,b\n"), ".csv"
    ),
    "coco": Reader(read_source, texts(_COCO), ".json"),
    "labelme": Reader(read_source, texts(_LABELME), ".json"),
    "knots": Reader(
        lambda path: read_knots(in_folder(path, KNOTS_JSON)),
        texts('{"0": [[[1, 2]], []], "1": [[[3, 4], [5, 6]], [[1, 1]]]}'),
    ),
    "tapvid": Reader(read_npz, _npz, ".npz"),
    "photo-mask": Reader(lambda path: photo.read_mask(path, _SIZE), _pictures, ".png"),
    "photo-depth": Reader(lambda path: photo.read_depth(path, _SIZE), _pictures, ".png"),
    "npy-depth": Reader(lambda path: photo.read_depth(path, _SIZE), _npy, ".npy"),
    "answers-csv": Reader(_answers, texts(_TABLE), ".csv"),
    "answers-jsonl": Reader(
        _answers, texts('{"pair_id": 0, "query_id": 0, "u": 1.5, "v": 2}\n' * 2), ".jsonl"
    ),
    "answers-parquet": Reader(_answers, files(TINY, "submission.parquet"), ".parquet"),
    "weights": Reader(read_weights_file, lambda: [_weights()], ".safetensors"),
    "checkpoint": Reader(_checkpoint, texts(_STATE)),
    "run-json": Reader(read_run_json, texts('{"steps": 3, "dataset": {"id": "a"}}'), ".json"),
    "report": Reader(
        lambda path: read_scores(in_folder(path, SCORES_JSON, _report()[1])),
        lambda: [(_report()[1] / SCORES_JSON).read_bytes()],
    ),
    "receipt": Reader(_receipt, _receipts, ".json"),
    "public-key": Reader(read_public_key, _public_key, ".pem"),
    "secret-seed": Reader(
        lambda path: read_secret_seed(in_folder(path, SECRET_SEED_FILE)),
        texts('{"seed": "a1b2c3d4e5f60718293a4b5c6d7e8f90"}'),
    ),
}
