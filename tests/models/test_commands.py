from __future__ import annotations

from pathlib import Path

import pytest

from pliant.models.don.settings import DonSettings, LossSettings
from pliant.models.don.trainer import shipped_recipe
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from tests.conftest import Called
from tests.models.tiny_runs import DON, options


@pytest.mark.parametrize("method", ["don", "timecycle"])
def test_resume_where_there_is_no_run_asks_for_no_setting(
    tiny_dataset: Path, tmp_path: Path, called: Called, method: str
) -> None:
    train = ("train", method, "--data", tiny_dataset, "--out", tmp_path / "nothing")
    code, _, error = called(*train, "--resume")
    assert code == 1
    assert "no checkpoint to resume" in error


@pytest.mark.parametrize(
    ("place", "fix"),
    [
        ("pliant.models.training.loop._step", "Interrupted: continue with --resume --out '{run}'"),
        ("pliant.models.don.trainer.draw_validation_pairs", ""),
    ],
)
def test_resume_is_proposed_where_there_is_a_checkpoint(
    sheet_dataset: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    called: Called,
    place: str,
    fix: str,
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(place, interrupt)
    run = tmp_path / "a run"
    train = ("train", "don", "--data", sheet_dataset.root, "--out", run)
    code, _, error = called(*train, *options(*DON))
    assert code == 130
    assert ("--resume" in error) == bool(fix)
    assert fix.format(run=run) in error


@pytest.mark.parametrize("config", ["steps: 5", "loss: {canonical_weight: 1.0}"])
def test_predict_refuses_a_folder_without_weights(
    sheet_dataset: Dataset, tmp_path: Path, called: Called, config: str
) -> None:
    (tmp_path / "config.yaml").write_text(config + "\n")
    out = tmp_path / "sub.parquet"
    code, _, error = called("predict", tmp_path, "--data", sheet_dataset.root, "--out", out)
    assert code == 1
    assert "no validated weights yet" in error


def test_a_run_is_resumed_with_the_settings_of_its_checkpoint(
    sheet_dataset: Dataset, tmp_path: Path, called: Called
) -> None:
    """What `--resume` reads without settings is config.yaml, which may have been edited since."""
    run = tmp_path / "run"
    train = ("train", "don", "--data", sheet_dataset.root, "--out", run)
    assert called(*train, *options(*DON, "steps=2"))[0] == 0
    config = run / "config.yaml"
    written = config.read_text()
    config.write_text(written.replace("descriptor_dim: 4", "descriptor_dim: 8"))
    code, _, error = called(*train, "--resume")
    assert code == 1
    assert "config.yaml, network.descriptor_dim: a run resumes only with" in error
    assert "found 8; required: 4. Leave --config and --set out and config.yaml as it was" in error
    config.write_text(written.replace("threads: 0", "threads: 1"))
    assert called(*train, "--resume")[0] == 0
    code, _, error = called(*train, "--resume", "--set", "validation.every=9")
    assert code == 1
    assert "config.yaml, validation.every: a run resumes only with" in error
    code, _, error = called("train", "timecycle", *train[2:], "--resume")
    assert code == 1
    assert "run: the run is of another method, or its config was edited" in error


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("loss.sigma_px=-1", "invalid setting; found -1; required: > 0 px"),
        ("network.name=vgg", 'invalid setting; found "vgg"; required: one of unet'),
        ("network.descriptor_dim=1000000000", "found 1000000000; required: 1 to 1024"),
        ("network.widths=[8, 1000000000]", "required: 8 to 1024"),
        ("network.widths=[8,8,8,8,8,8,8,8,32]", "two to eight multiples of 8"),
        ("network.global_blocks=1000000000", "required: 0 to 64"),
        ("batch=1000000000", "required: 1 to 4096"),
        ("workers=1000000000", "required: 0 to 256"),
        ("seed=20301130123456", "found 20301130123456; required: 0 to 4294967295"),
        ("loss.time_weight=1", "required: 'sequence' or 'next' for loss.time_weight above 0"),
        ("answer.rotations=3", "unknown value; found 3; required: one of 1, 2 or 4"),
    ],
)
def test_wrong_settings_are_one_sentence(override: str, message: str) -> None:
    with pytest.raises(CallError) as caught:
        read_settings(DonSettings, None, [override])
    assert message in str(caught.value)


def test_a_blank_picture_needs_a_picture_and_masks() -> None:
    for other in ("pairs.masks=false", "pairs.input=depth"):
        with pytest.raises(CallError, match=r"augment\.picture_drop: .*required: 0 unless"):
            read_settings(
                DonSettings, None, ["pairs.masks=true", other, "augment.picture_drop=0.1"]
            )


def test_the_target_narrows_over_the_first_half() -> None:
    loss = LossSettings(sigma_px=1.0, sigma_start_px=4.0)
    assert [loss.sigma_at(p) for p in (0.0, 0.25, 0.5, 1.0)] == pytest.approx([4.0, 2.0, 1.0, 1.0])
    assert LossSettings(sigma_px=1.5).sigma_at(0.1) == 1.5


def test_a_cloth_is_trained_with_another_recipe_than_a_rope(tiny_dataset: Path) -> None:
    """Ropes turn by any angle, a blank cloth by less than 45 degrees: its corners look alike."""
    dataset = Dataset.open(tiny_dataset)
    rope = read_settings(DonSettings, shipped_recipe(dataset, "rope"))
    cloth = read_settings(DonSettings, shipped_recipe(dataset, "cloth-1"))
    assert rope.augment.rotate_deg == 180
    assert cloth.augment.rotate_deg < 45
    assert not cloth.loss.symmetric
    with pytest.raises(CallError, match="name the tier"):
        shipped_recipe(dataset, "")
    with pytest.raises(CallError, match="no such tier"):
        shipped_recipe(dataset, "sail")
