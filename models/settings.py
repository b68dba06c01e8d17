"""The config of a training run: frozen, self-checking, YAML in and the same out."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

from pliant.loaders import AugmentSettings, PairSettings
from pliant.models.losses.distributional import Direction
from pliant.models.networks import NetworkSettings
from pliant.spec.errors import CallError
from pliant.spec.yamlfiles import parse_yaml, read_yaml

S = TypeVar("S")


@dataclass(frozen=True)
class LossSettings:
    """What is minimised. Pixels are those of the network's input.

    Attributes:
        kind: `distributional` or `contrastive`.
        sigma_px: Distributional: width of the target's Gaussians, at the end.
        sigma_start_px: Their width at the start, 0 for `sigma_px` throughout. It shrinks
            geometrically over the first half of the training: a wide target tells a network that
            knows nothing yet which way to go.
        direction: Distributional: `forward` KL(q || p) or `reverse` KL(p || q).
        symmetric: Spread the target over the symmetry orbit (contrastive: keep partners from
            being non-matches).
        initial_scale: First inverse temperature.
        learn_scale: Whether it is learned.
        background: Distributional: pixels off the object, drawn anew each step, that compete
            besides all pixels on it; -1 for all pixels.
        bin_px: Distributional: side of the bins (means of descriptors) that compete, >= 1.
        chunk: Queries at a time (memory for time); 0 for all.
        margin: Contrastive: M.
        non_matches: Contrastive: pixels a query, half on the object.
        guard_px: Contrastive: no non-match lies this near to a match.
        squared: Contrastive: squared hinge.
        hard_scaling: Contrastive: divide by the non-matches inside the margin.
        space_weight: Weight of the Lipschitz condition in space, 0 for none.
        space_constant: Its constant.
        space_mu: (first, last) value of mu, growing geometrically.
        space_radius_px: Radius of the sampled patch.
        space_pixels: Pixels of the patch.
        time_weight: Weight of the Lipschitz condition in time, 0 for none; it needs pairs of
            one episode (`pairs.pairing` sequence or next).
        time_constant: Its constant.
        orientation_weight: Weight of the orientation loss, 0 for none; it needs matches from the
            points.
    """

    kind: Literal["distributional", "contrastive"] = "distributional"
    sigma_px: float = 1.0
    sigma_start_px: float = 0.0
    direction: Direction = "forward"
    symmetric: bool = True
    initial_scale: float = 1.0
    learn_scale: bool = True
    background: int = 512
    bin_px: int = 1
    chunk: int = 0
    margin: float = 0.5
    non_matches: int = 150
    guard_px: float = 2.0
    squared: bool = True
    hard_scaling: bool = True
    space_weight: float = 0.0
    space_constant: float = 2.0
    space_mu: tuple[float, float] = (0.01, 1.0)
    space_radius_px: float = 6.0
    space_pixels: int = 12
    time_weight: float = 0.0
    time_constant: float = 1.5
    orientation_weight: float = 0.0

    def sigma_at(self, progress: float) -> float:
        """Return the width of the target's Gaussians at a share of the training, px.

        Args:
            progress: Share of the training done, 0 to 1.
        """
        first = self.sigma_start_px or self.sigma_px
        return first * (self.sigma_px / first) ** min(2 * progress, 1.0)

    def __post_init__(self) -> None:
        positive = ("sigma_px", "initial_scale", "margin", "space_constant", "time_constant")
        for name in positive:
            if not getattr(self, name) > 0:
                raise ValueError(f"loss.{name} must be > 0")
        weights = ("space_weight", "time_weight", "orientation_weight")
        for name in ("chunk", "guard_px", "sigma_start_px", *weights):
            if getattr(self, name) < 0:
                raise ValueError(f"loss.{name} must be >= 0")
        if self.background < -1 or self.bin_px < 1 or self.non_matches < 2:
            raise ValueError("loss.background >= -1, bin_px >= 1, non_matches >= 2 are required")
        if not 0 < self.space_mu[0] <= self.space_mu[1] or self.space_pixels < 2:
            raise ValueError("loss.space_mu must grow from above 0, space_pixels be >= 2")


@dataclass(frozen=True)
class OptimiserSettings:
    """The optimiser and how its learning rate goes.

    Attributes:
        kind: `adamw`, or `muon` for the layers' weights (`models/muon.py`) and AdamW for the rest.
        learning_rate: AdamW's highest value.
        matrix_rate: Muon's highest value; it follows the same schedule.
        weight_decay: Decoupled weight decay.
        beta1: Share kept, each step, of the running mean of the gradient.
        schedule: `cosine` to zero, `step` (times `step_factor` every `step_every`), `constant`.
        warmup: Steps of linear rise at the start.
        step_every: Steps.
        step_factor: 0 to 1.
        clip_norm: Largest norm of the gradient, 0 for no clipping.
        average: Share kept, each step, of the running average of the weights that validates and
            answers; 0 uses the weights themselves.
    """

    kind: Literal["adamw", "muon"] = "adamw"
    learning_rate: float = 2e-3
    matrix_rate: float = 0.02
    weight_decay: float = 1e-4
    beta1: float = 0.9
    schedule: Literal["cosine", "step", "constant"] = "cosine"
    warmup: int = 100
    step_every: int = 250
    step_factor: float = 0.9
    clip_norm: float = 1.0
    average: float = 0.99

    def __post_init__(self) -> None:
        if not self.learning_rate > 0 or not self.matrix_rate > 0:
            raise ValueError("optimiser: learning_rate and matrix_rate > 0")
        if self.weight_decay < 0 or self.clip_norm < 0:
            raise ValueError("optimiser: weight_decay and clip_norm >= 0")
        if self.warmup < 0 or self.step_every < 1 or not 0 < self.step_factor <= 1:
            raise ValueError("optimiser: warmup >= 0, step_every >= 1, 0 < step_factor <= 1")
        if not 0 <= self.average < 1 or not 0 <= self.beta1 < 1:
            raise ValueError("optimiser.average and beta1 must be 0 to 1")


@dataclass(frozen=True)
class ValidationSettings:
    """How a run is watched.

    Attributes:
        split: Split to validate on; its truth is also what the answers are calibrated with.
        every: Steps between validations.
        pairs: Image pairs.
        queries: Queries a pair.
        patience: Validations without a lower RMSE after which to stop; 0 never stops.
        calibration_pairs: Image pairs to calibrate on, at the end.
        keep: Which weights answer: the `best` validated ones, or the `last`, which a learning rate
            that ends at 0 has brought to rest, where few pairs cannot tell the better ones.
    """

    split: str = "val"
    every: int = 250
    pairs: int = 32
    queries: int = 64
    patience: int = 0
    calibration_pairs: int = 100
    keep: Literal["best", "last"] = "best"

    def __post_init__(self) -> None:
        if min(self.every, self.pairs, self.queries, self.calibration_pairs) < 1:
            raise ValueError("validation: every, pairs, queries, calibration_pairs must be >= 1")
        if self.patience < 0:
            raise ValueError("validation.patience must be >= 0")


@dataclass(frozen=True)
class AnswerSettings:
    """How a trained network answers.

    Attributes:
        decode: `argmax` (refined to a fraction of a pixel), `median` (the pixel with the least
            expected distance, refined; the default) or `soft` (the mean: lowest squared error
            where the network doubts, but off the object then).
        search: In the object's `mask` where one is given out, or anywhere in the `image`.
        rotations: 1, 2 or 4: how many quarter-turned copies of both images vote.
        distribution: `modes`, `sigma` or `none`: what the answers say of their certainty.
    """

    decode: Literal["argmax", "median", "soft"] = "median"
    search: Literal["mask", "image"] = "mask"
    rotations: int = 1
    distribution: Literal["modes", "sigma", "none"] = "modes"

    def __post_init__(self) -> None:
        if self.rotations not in (1, 2, 4):
            raise ValueError("answer.rotations must be 1, 2 or 4")


@dataclass(frozen=True)
class RunSettings:
    """What every training run is told, whatever it trains.

    Attributes:
        tier: Tier to train on; empty where the dataset has only one.
        split: Split to train on.
        limit: Train on the first so many sequences only; 0 for all.
        width: Width that frames are brought to, px: the network's input.
        height: Its height.
        seed: Seed of weights, samples and draws.
        steps: Optimiser steps.
        batch: Samples a step and process.
        precision: `float32` or `bfloat16` (forward and backward of the network).
        threads: CPU threads of torch; 0 leaves torch's own choice.
        workers: Loader processes; 0 loads in the training process.
        cache: Keep decoded frames in RUN/cache.
        checkpoint_every: Steps between checkpoints.
    """

    tier: str = ""
    split: str = "train"
    limit: int = 0
    width: int = 160
    height: int = 120
    seed: int = 0
    steps: int = 3000
    batch: int = 8
    precision: Literal["float32", "bfloat16"] = "float32"
    threads: int = 0
    workers: int = 0
    cache: bool = True
    checkpoint_every: int = 250

    def __post_init__(self) -> None:
        for name in ("steps", "batch", "checkpoint_every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be >= 1")
        for name in ("limit", "seed", "threads", "workers"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must be >= 0")


@dataclass(frozen=True)
class DonSettings(RunSettings):
    """A whole run of Dense Object Nets.

    Attributes:
        pairs: What a sample holds.
        augment: What happens to training frames.
        network: The network.
        loss: The loss.
        optimiser: The optimiser.
        validation: How the run is watched.
        answer: How the result answers.
    """

    pairs: PairSettings = field(default_factory=PairSettings)
    augment: AugmentSettings = field(default_factory=AugmentSettings)
    network: NetworkSettings = field(default_factory=NetworkSettings)
    loss: LossSettings = field(default_factory=LossSettings)
    optimiser: OptimiserSettings = field(default_factory=OptimiserSettings)
    validation: ValidationSettings = field(default_factory=ValidationSettings)
    answer: AnswerSettings = field(default_factory=AnswerSettings)

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if not 8 <= getattr(self, name) <= 8192:
                raise ValueError(f"{name} must be 8 to 8192")
        super().__post_init__()
        if self.loss.time_weight > 0 and self.pairs.pairing == "any":
            raise ValueError("loss.time_weight needs pairs.pairing 'sequence' or 'next'")
        if self.loss.orientation_weight > 0 and self.pairs.matches != "points":
            raise ValueError("loss.orientation_weight needs pairs.matches 'points'")


def settings_from(cls: type[S], values: Mapping[str, Any], where: str = "") -> S:
    """Build settings from plain values, refusing keys and types they do not know.

    Args:
        cls: A frozen dataclass that checks itself.
        values: Field name -> value; lists for tuples, mappings for nested settings.
        where: Dotted name of these settings, for messages.

    Raises:
        CallError: An unknown key, a wrong type, or a value the class refuses.
    """
    if not isinstance(values, Mapping):
        raise CallError("settings must be a mapping", where=where or None, found=repr(values)[:80])
    hints = typing.get_type_hints(cls)
    names = [each.name for each in dataclasses.fields(cls)]  # type: ignore[arg-type]
    arguments = {}
    for key, value in values.items():
        place = f"{where}.{key}" if where else str(key)
        if key not in names:
            raise CallError("unknown setting", where=place, required="one of " + ", ".join(names))
        arguments[key] = _converted(hints[key], value, place)
    try:
        return cls(**arguments)
    except ValueError as error:
        raise CallError(str(error), where=where or None) from error


def _converted(hint: Any, value: Any, where: str) -> Any:
    origin, options = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return value if isinstance(value, hint) else settings_from(hint, value, where)
    if origin is typing.Literal:
        if value in options:
            return value
        raise CallError("unknown value", where=where, found=repr(value), required=str(options))
    if origin is tuple:
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise CallError("a list is required", where=where, found=repr(value))
        if options[-1] is not Ellipsis and len(value) != len(options):
            raise CallError(
                "wrong length", where=where, found=len(value), required=f"{len(options)} values"
            )
        return tuple(_converted(options[0], item, where) for item in value)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
        raise CallError("wrong type", where=where, found=repr(value), required=hint.__name__)
    return value


def settings_to_dict(settings: Any) -> dict[str, Any]:
    """Return settings as plain values, what `settings_from` takes."""
    plain: dict[str, Any] = _plain(dataclasses.asdict(settings))
    return plain


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value


def read_settings(
    cls: type[S], path: Path | None, overrides: Sequence[str] = (), base: Mapping[str, Any] = {}
) -> S:
    """Build settings from a YAML file and `key.sub=value` overrides.

    Args:
        cls: The settings' class.
        path: A YAML file, or None for the defaults.
        overrides: `dotted.key=value`, the value in YAML, so `1e-3` and `[8, 16]` work.
        base: Plain values under the file's.

    Raises:
        CallError: The file cannot be read, or a key or value is wrong.
    """
    values: dict[str, Any] = _plain(dict(base))
    if path is not None:
        loaded = read_yaml(path)
        if loaded is not None and not isinstance(loaded, dict):
            raise CallError("the config must be a mapping", path=path)
        _merge(values, loaded or {})
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals:
            raise CallError("--set wants key=value", found=repr(override))
        nested: Any = parse_yaml(text, where=f"--set {key}")
        for part in reversed(key.strip().split(".")):
            nested = {part: nested}
        _merge(values, nested)
    return settings_from(cls, values)


def _merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = _plain(dict(value)) if isinstance(value, Mapping) else value
