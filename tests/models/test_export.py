"""Small forms of finished runs, and the models that come with the package."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
import yaml

from pliant.baselines.predict import predict
from pliant.evaluator import evaluate, write_report
from pliant.generator.config import GenerateConfig
from pliant.models import load_matcher, shipped
from pliant.models.don.ball import BallNetwork
from pliant.models.don.loading import load_matcher as load_don
from pliant.models.don.settings import DonSettings
from pliant.models.don.trainer import train_don
from pliant.models.export import export_run, halved, training_seconds
from pliant.models.model_card import model_card
from pliant.models.networks.mask_network import MASKS, MaskNetwork
from pliant.models.networks.print_network import PRINTS, PrintNetwork
from pliant.models.shipped import load_shipped, shipped_names
from pliant.models.timecycle.trainer import train_timecycle
from pliant.models.training.checkpoint import save_weights
from pliant.models.training.run_folder import BALL, data_digest, write_settings
from pliant.publishing import PublishSettings, publish
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, TrainingError
from pliant.spec.frame import Pair
from pliant.spec.io.parquet import read_footer
from tests.conftest import Called
from tests.known import known
from tests.models.shipped_models import shipped_don
from tests.models.tiny_runs import don, timecycle


@pytest.fixture(scope="module")
def dataset(tiny_dataset: Path) -> Dataset:
    return Dataset.open(tiny_dataset)


@pytest.fixture(scope="module")
def trained(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained") / "run"
    settings = don("tier=rope", "steps=12", "width=80", "height=60", "validation.every=12")
    train_don(dataset, folder, settings)
    return folder


@pytest.fixture(scope="module")
def models(trained: Path, dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of models with one, `don-tiny`, whose card has scores."""
    out = tmp_path_factory.mktemp("models")
    submission = out / "sub.parquet"
    predict(dataset, "test", load_don(trained), submission)
    scores = evaluate(submission, dataset, protocol="paper", allow_missing=True)
    write_report(scores, out / "report")
    submission.unlink()
    export_run(trained, "don-tiny", out / "shipped", dataset, [scores])
    return out / "shipped"


@pytest.fixture
def as_shipped(models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shipped, "FOLDER", models)


@pytest.mark.usefixtures("as_shipped")
def test_half_the_size_and_the_same_answers(trained: Path, models: Path, dataset: Dataset) -> None:
    small = models / "don-tiny" / "best.safetensors"
    assert small.stat().st_size < 0.6 * (trained / "best.safetensors").stat().st_size
    whole, half = load_don(trained), shipped_don("don-tiny")
    assert half.calibration == whole.calibration
    assert {p.dtype for p in half.network.parameters()} == {torch.float32}
    a, b = [s for s in dataset.sequences if s.tier == "rope"][:2]

    source, target = a[0], b[0]
    row, column = np.nonzero(known(source.mask))
    uv = np.stack([column, row], axis=1)[::8].astype(np.float32) + 0.5
    found, expected = (m.answer(Pair(source, target, uv)).uv_px for m in (half, whole))
    distance = np.hypot(*(found - expected).T)
    assert len(uv) > 50
    assert np.quantile(distance, 0.9) < 0.05
    assert (found != expected).any()  # it is another set of weights


def test_halving_keeps_what_would_be_lost() -> None:
    weights = {
        "matrix": torch.ones(3, 3),
        "large": torch.full((2, 2), 1e5),
        "vector": torch.ones(3),
        "count": torch.ones(2, 2, dtype=torch.int64),
    }
    kinds = {name: tensor.dtype for name, tensor in halved(weights).items()}
    assert kinds == {
        "matrix": torch.float16,
        "large": torch.float32,
        "vector": torch.float32,
        "count": torch.int64,
    }


def test_card_says_what_it_is(trained: Path, models: Path, dataset: Dataset) -> None:
    card = (models / "don-tiny" / "CARD.md").read_text()
    facts = json.loads((trained / "run.json").read_text())
    scores = json.loads((models.parent / "report" / "scores.json").read_text())
    for expected in (
        "# don-tiny\n",
        "pliant predict don-tiny --data DATA",
        f"Dataset `{dataset.id}`",
        "12 steps of 1 samples",
        f"RMSE\n{facts['validation']['rmse_px']:.2f} px",
        f"| rope | {scores['tiers']['rope']['rmse_px']:.2f}",
        "Protocol `paper`",
        "--scores REPORT",
    ):
        assert " ".join(expected.split()) in " ".join(card.split())
    assert "None" not in card
    assert max(map(len, card.splitlines())) < 200


def test_card_of_timecycle(tiny_episode: Path, tmp_path: Path) -> None:
    """Its figures are over time; it has no mean over pairs and no median."""
    run_folder, dataset = tmp_path / "run", Dataset.open(tiny_episode)
    facts = train_timecycle(dataset, run_folder, timecycle("steps=2"))
    folder = export_run(run_folder, "walker", tmp_path / "models", dataset)
    card = " ".join((folder / "CARD.md").read_text().split())
    assert f"RMSE {facts['validation']['rmse_px']:.2f} px of a picture 640 px wide" in card
    assert facts["guard"]["verdict"] in card
    assert load_matcher(folder).name == "walker"


def test_card_of_other_data(trained: Path, dataset: Dataset) -> None:
    """A depth style shows neither material nor light, and an imported set names no config."""
    info = dataset.info
    provenance = info["provenance"]

    def card(changes: dict[str, Any], further: Any = (), **of_run: object) -> str:
        return model_card(
            name="a",
            settings=yaml.safe_load((trained / "config.yaml").read_text()),
            facts=json.loads((trained / "run.json").read_text()) | of_run,
            dataset={**info, "provenance": {**provenance, **changes}},
            parameters=1,
            training_s=9000.0,
            further=further,
        ).replace("\n", " ")

    plain = card({})
    assert "| light |" in plain
    assert "2.5 h" in plain
    deep = card({"config": {**provenance["config"], "style": "real-depth"}})
    assert "| light |" not in deep
    assert "no colour" in deep
    unknown = card({"config": None})
    assert "| light |" not in unknown
    assert "data.yaml" not in unknown
    free = {**info, "provenance": {**provenance, "config": {"lens": "50 mm"}}}
    assert card(free["provenance"], further=[free]) == card({"config": None}, further=[free])
    secret = card({"config": {k: v for k, v in provenance["config"].items() if k != "seed"}})
    assert "| seed | secret |" in secret
    assert "`data.yaml` has the complete config, without the seed." in secret
    assert "pliant generate --config" in plain
    assert "pliant generate --config" not in secret
    mean = card({}, mean_of=["first", "further"], share_of_the_last=0.3, processes=2)
    assert "0.7 of `first` and 0.3 of `further`" in mean
    assert "of the validation split, which chose the weights" in mean
    assert "12 steps of 2 samples, 2 processes with threads" in mean


def test_data_config_makes_the_same_dataset(models: Path, dataset: Dataset) -> None:
    config = read_settings(GenerateConfig, models / "don-tiny" / "data.yaml")
    stored = dataset.info["provenance"]["config"]
    assert config.resolved() == stored


def test_training_time_is_read_from_the_log(trained: Path, tmp_path: Path) -> None:
    assert 0 < (training_seconds(trained) or 0) < 300
    assert training_seconds(tmp_path) is None


def test_a_shipped_name_is_a_method(
    as_shipped: None, dataset: Dataset, tmp_path: Path, called: Called
) -> None:
    out = tmp_path / "sub.parquet"
    data = ("--data", dataset.root)
    assert called("predict", "don-tiny", *data, "--split", "test", "--out", out)[0] == 0
    assert called("check", out, *data)[0] == 0
    method = read_footer(out)["method"]
    assert method["name"] == "don-tiny"
    assert method["steps"] == 12
    frame = dataset.sequences[0].dir / "rgb" / "000000.png"
    figure = tmp_path / "figure.png"
    call = ("--source", frame, "--target", frame, "--at", "80,60", "--out", figure)
    _, said, _ = called("match", "don-tiny", *call, "--json")
    assert json.loads(said)["method"] == "don-tiny"
    assert figure.is_file()
    code, _, error = called("predict", "don-tinny", *data, "--out", out)
    assert code == 2
    assert "Did you mean don-tiny?" in error


def test_a_run_of_the_same_name_is_not_taken_for_it(
    as_shipped: None,
    trained: Path,
    dataset: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    called: Called,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("don-tiny").symlink_to(trained)
    call = ("--data", dataset.root, "--out", "sub.parquet")
    code, _, error = called("predict", "don-tiny", *call)
    assert code == 2
    assert "Write ./don-tiny for the run" in error
    assert called("predict", "./don-tiny", *call)[0] == 0
    assert read_footer(Path("sub.parquet"))["method"]["name"] == "don"


def test_export_command(
    trained: Path,
    models: Path,
    dataset: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    called: Called,
) -> None:
    call = ("train", "export", trained, "--name", "a-model", "--data", dataset.root)
    scores, card = models.parent / "report" / "scores.json", tmp_path / "a-model" / "CARD.md"
    _, said, _ = called(*call, "--scores", scores, "--out", tmp_path, "--json")
    assert json.loads(said)["model"] == str(tmp_path / "a-model")
    assert "Protocol `paper`" in card.read_text()
    status, _, said = called(*call, "--out", tmp_path)  # it may be of another run, or edited
    assert (status, "the model exists already" in said) == (2, True)
    assert "Protocol `paper`" in card.read_text()
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    assert shipped_names() == ("a-model",)


def test_export_of_a_run_on_simulated_frames(
    trained: Path, models: Path, tmp_path: Path, called: Called
) -> None:
    """`--data` is what the training was given: a YAML file too."""
    config = models / "don-tiny" / "data.yaml"
    call = ("train", "export", trained, "--name", "a-model", "--out", tmp_path)
    assert called(*call, "--data", config)[0] == 0
    written = tmp_path / "a-model" / "data.yaml"
    assert yaml.safe_load(written.read_text()) == yaml.safe_load(config.read_text())


def test_what_cannot_be_shipped_is_refused(
    trained: Path, models: Path, dataset: Dataset, sheet_dataset: Dataset, tmp_path: Path
) -> None:
    with pytest.raises(CallError, match="name cannot be used; found 'Don/Rope'"):
        export_run(trained, "Don/Rope", tmp_path, dataset)
    with pytest.raises(CallError, match="trained on another dataset"):
        export_run(trained, "don", tmp_path, sheet_dataset)
    same_id, public = tmp_path / "same-id", tmp_path / "public"
    shutil.copytree(dataset.root, same_id)
    listed = same_id / "sequences.parquet"
    pq.write_table(pq.read_table(listed).slice(1), listed)
    with pytest.raises(CallError, match="other sequences than the run was trained on"):
        export_run(trained, "don", tmp_path, Dataset.open(same_id))
    publish(dataset.root, public, PublishSettings(hold_out=("test",), answers_are_public=True))
    export_run(trained, "from-public", tmp_path / "public-card", Dataset.open(public))
    with pytest.raises(CallError, match="not a training run"):
        export_run(tmp_path, "don", tmp_path, dataset)
    (tmp_path / "mine").mkdir()
    with pytest.raises(CallError, match="the model exists already"):
        export_run(trained, "mine", tmp_path, dataset)
    begun = tmp_path / "begun"
    begun.mkdir()
    for name in ("config.yaml", "best.safetensors"):
        (begun / name).write_bytes((trained / name).read_bytes())
    with pytest.raises(CallError, match=r"not finished.*add --resume to the"):
        export_run(begun, "don", tmp_path, dataset)
    from pliant.evaluator.scores import read_scores

    report = read_scores(models.parent / "report")
    report.document["submission"]["method"]["steps"] = 13
    message = r"method\.steps: the report is of another run; found 13 of the method 'don'; .* 12"
    with pytest.raises(CallError, match=message):
        export_run(trained, "don", tmp_path, dataset, [report])
    assert not list(tmp_path.glob("*/CARD.md"))


@pytest.mark.usefixtures("as_shipped")
def test_unknown_and_damaged_models_are_refused(
    models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(CallError, match="no model 'don-rpe' is shipped; required: don-tiny"):
        load_shipped("don-rpe")
    (tmp_path / "don-x").mkdir()
    for name in ("CARD.md", "config.yaml", "best.safetensors"):
        content = (models / "don-tiny" / name).read_bytes()
        (tmp_path / "don-x" / name).write_bytes(content[:200])
    (tmp_path / "don-x" / "config.yaml").write_text("tier: rope\n")
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    with pytest.raises(TrainingError, match="weights cannot be read"):
        load_shipped("don-x")
    for name in ("config.yaml", "best.safetensors", "run.json"):
        shutil.copyfile(models / "don-tiny" / name, tmp_path / "don-x" / name)
    with pytest.raises(TrainingError, match=r"calibration\.json: the calibration .* is missing"):
        load_shipped("don-x")
    shutil.copyfile(models / "don-tiny/calibration.json", tmp_path / "don-x/calibration.json")
    (tmp_path / "don-x/familiarity.json").write_text("{}")
    with pytest.raises(TrainingError, match=r"familiarity\.json: the familiarity is damaged"):
        load_shipped("don-x")


def test_small_networks_are_exported_and_damaged_ones_refused(
    trained: Path, dataset: Dataset, tmp_path: Path
) -> None:
    run = shutil.copytree(trained, tmp_path / "run")
    save_weights(run / MASKS, MaskNetwork().state_dict())
    save_weights(run / BALL, BallNetwork().state_dict())
    save_weights(run / PRINTS, PrintNetwork().state_dict())
    folder = export_run(run, "a-model", tmp_path, dataset)
    for name in (MASKS, BALL, PRINTS):
        whole = (folder / name).read_bytes()
        (folder / name).write_bytes(whole[:200])
        with pytest.raises(TrainingError, match=rf"a-model/{name}: the weights cannot be read"):
            load_don(folder)
        (folder / name).write_bytes(whole)
    load_don(folder)


def test_further_data_and_first_weights_are_named_without_paths(
    trained: Path, dataset: Dataset, tmp_path: Path
) -> None:
    """The card of a run on several sets names them all; its config has no path of this machine."""
    settings = read_settings(DonSettings, trained / "config.yaml")
    network = settings.network.replace(pretrained=str(trained))
    changed = settings.replace(
        network=network,
        also=(f"{dataset.root}#rope", "#rope"),
        steps=2,
        cache_dir=str(tmp_path / "cache"),
    )
    train_don(dataset, tmp_path / "run", changed)
    folder = export_run(tmp_path / "run", "don-more", tmp_path / "out", dataset)
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert config["also"] == [f"{dataset.id}#rope", "#rope"]
    assert config["network"]["pretrained"] == trained.name
    assert str(tmp_path) not in "".join(p.read_text() for p in folder.glob("*.yaml"))
    assert (folder / f"data-{dataset.id}.yaml").read_text() == (folder / "data.yaml").read_text()
    card = " ".join((folder / "CARD.md").read_text().split())
    assert (
        f"It was trained on these sets too, each with its config in `data-ID.yaml`: `{dataset.id}`"
        in card
    )
    assert f"The weights started from those of `{trained.name}`." in card
    assert "Trained on tier `rope`." in card
    load_matcher(folder)
    # One of the sets has become another one of the same id.
    other = tmp_path / "other"
    shutil.copytree(dataset.root, other)
    info = json.loads((other / "dataset.json").read_text())
    info["provenance"]["config"]["frames"] = 7
    (other / "dataset.json").write_text(json.dumps(info))
    named = changed.replace(also=(f"{dataset.root}#rope", "#rope", f"{other}#rope"))
    write_settings(tmp_path / "run", named)
    state = next((tmp_path / "run").glob("checkpoints/*/state.json"))
    with pytest.raises(CallError, match="other sequences than the run was trained on"):
        export_run(tmp_path / "run", "don-more", tmp_path / "out", dataset, replace=True)
    digest = data_digest([dataset, dataset, dataset, Dataset.open(other)])
    state.write_text(json.dumps(json.loads(state.read_text()) | {"data": digest}))
    folder = export_run(tmp_path / "run", "don-more", tmp_path / "out", dataset, replace=True)
    assert (folder / f"data-{dataset.id}.yaml").read_text() == (folder / "data.yaml").read_text()
    assert "frames: 7\n" in (folder / f"data-{dataset.id}-2.yaml").read_text()


@pytest.mark.parametrize(
    ("also", "phrase"),
    [
        ([], "tier `cloth-3`"),
        (["a", "b#cloth-1"], "tiers `cloth-1` and `cloth-3`"),
        (["a#cloth-2", "#cloth-1", "c#cloth-2"], "tiers `cloth-1`, `cloth-2` and `cloth-3`"),
    ],
)
def test_card_names_all_tiers(also: list[str], phrase: str) -> None:
    size = {"width": 640, "height": 480}
    dataset = {"id": "d", "version": "1.0.0", "title": "D", "image_size": size}
    facts = {"tier": "cloth-3", "split": "train", "steps": 3, "processes": 1, "seed": 0}
    card = model_card(
        name="m",
        settings={"width": 80, "height": 60, "batch": 1, "network": {}, "also": also},
        facts={**facts, "device": "cpu"},
        dataset={**dataset, "provenance": {"generator": "pliant"}},
        parameters=5,
        training_s=None,
    )
    assert f"Trained on {phrase}." in card
    assert f"It is trained for the objects of {phrase} only" in " ".join(card.split())
