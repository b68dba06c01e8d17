"""Settings of a run of Dense Object Nets."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple, Self

from pydantic import model_validator

from pliant.loaders import AugmentSettings, PairSettings
from pliant.models.losses.distributional import Direction
from pliant.models.networks.descriptor_network import NetworkSettings
from pliant.models.training.settings import RunSettings, ValidationSettings
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds, Count, Natural, NonNegative, Positive, Range, Refused


def shrinking(first: float, last: float, progress: float) -> float:
    """Return a width that shrinks geometrically over the first half of the training.

    Args:
        first: At the start.
        last: From the middle on.
        progress: Share of the training done, 0 to 1.
    """
    return float(first * (last / first) ** min(2 * progress, 1.0))


class LossSettings(Settings):
    """The training loss. Pixels are those of the network's input.

    Attributes:
        kind: `distributional` or `contrastive`.
        sigma_px: Distributional: width of the target's Gaussians, at the end.
        sigma_start_px: Their width at the start, 0 for `sigma_px` throughout. It shrinks
            geometrically over the first half of the training. A wide target gives useful gradients
            at the start.
        direction: Distributional: `forward` KL(q || p) or `reverse` KL(p || q).
        symmetric: Spread the target over all symmetric positions (contrastive: exclude them from
            the non-matches).
        initial_scale: Initial inverse temperature.
        learn_scale: Learn the inverse temperature.
        background: Distributional: number of background pixels, sampled in each step, that are
            candidates in addition to all pixels of the object; -1 for all pixels.
        bin_px: Distributional: side of the bins (means of descriptors) that are candidates, >= 1.
        chunk: Number of queries that are compared at a time, to save memory; 0 for all.
        margin: Contrastive: margin M.
        non_matches: Contrastive: non-matches per query, half of them on the object.
        guard_px: Contrastive: minimum distance between a non-match and a match.
        squared: Contrastive: distances of matches and hinges are squared.
        hard_scaling: Contrastive: divide by the non-matches inside the margin.
        space_weight: Weight of the Lipschitz condition in space, 0 for none.
        space_constant: Its constant.
        space_mu: (first, last) value of mu, growing geometrically.
        space_reach_m: Largest distance on the material between two points that it compares, metres.
        time_weight: Weight of the Lipschitz condition in time, 0 for none; it needs pairs of
            one episode (`pairs.pairing` sequence or next).
        time_constant: Its constant.
        orientation_weight: Weight of the orientation loss, 0 for none.
        canonical_weight: Weight of the canonical head's cross-entropy, 0 for no head.
        canonical_sigma_m: Width of its target on the material, at the end, metres.
        canonical_sigma_start_m: Width at the start; it shrinks as `sigma_start_px` does.
        stretch_weight: Weight of the loss of how the canonical head's map stretches the material;
            it needs `canonical_weight`.
        stretch_reach_m: Largest distance on the material of two points that are compared, metres.
        foreground_weight: Weight of the loss of the predicted masks, which are used where no mask
            is given; 0 for none.
    """

    kind: Literal["distributional", "contrastive"] = "distributional"
    sigma_px: Positive = 1.0
    sigma_start_px: NonNegative = 0.0
    direction: Direction = "forward"
    symmetric: bool = True
    initial_scale: Positive = 1.0
    learn_scale: bool = True
    background: Annotated[int, Bounds(-1)] = 512
    bin_px: Count = 1
    chunk: Natural = 0
    margin: Positive = 0.5
    non_matches: Annotated[int, Bounds(2)] = 150
    guard_px: NonNegative = 2.0
    squared: bool = True
    hard_scaling: bool = True
    space_weight: NonNegative = 0.0
    space_constant: Positive = 2.0
    space_mu: Annotated[Range, Bounds(0, above=True)] = (0.01, 1.0)
    space_reach_m: Positive = 0.04
    time_weight: NonNegative = 0.0
    time_constant: Positive = 1.5
    orientation_weight: NonNegative = 0.0
    canonical_weight: NonNegative = 0.0
    canonical_sigma_m: Positive = 0.012
    canonical_sigma_start_m: Positive = 0.1
    stretch_weight: NonNegative = 0.0
    stretch_reach_m: Positive = 0.12
    foreground_weight: NonNegative = 0.0

    @property
    def weights(self) -> dict[str, float]:
        """The weight of each auxiliary loss, by its name in the log."""
        return {
            "lipschitz_space": self.space_weight,
            "lipschitz_time": self.time_weight,
            "orientation": self.orientation_weight,
            "canonical": self.canonical_weight,
            "stretch": self.stretch_weight,
            "foreground": self.foreground_weight,
        }

    def canonical_sigma_at(self, progress: float) -> float:
        """Return the width of the canonical target at a share of the training, metres.

        Args:
            progress: Share of the training done, 0 to 1.
        """
        return shrinking(self.canonical_sigma_start_m, self.canonical_sigma_m, progress)

    def sigma_at(self, progress: float) -> float:
        """Return the width of the target's Gaussians at a share of the training, px.

        Args:
            progress: Share of the training done, 0 to 1.
        """
        return shrinking(self.sigma_start_px or self.sigma_px, self.sigma_px, progress)


class PairValidationSettings(ValidationSettings):
    """Validation during a run of Dense Object Nets.

    Attributes:
        split: Split for validation and for the calibration.
        pairs: Number of image pairs.
        queries: Queries per pair.
        calibration_pairs: Number of image pairs for the calibration at the end.
    """

    pairs: Count = 32
    queries: Count = 64
    calibration_pairs: Count = 100


class AnswerSettings(Settings):
    """Inference with a trained network.

    Attributes:
        decode: `argmax` (refined to a fraction of a pixel), `median` (the pixel with the least
            expected distance, refined; the default) or `soft` (the mean, which has the lowest
            squared error but may be off the object). `trace` is for ropes: `median` after the
            traced paths of both masks are combined with p (`models/don/tracing.py`).
        margin_px: Margin around the mask that is searched too, network pixels.
        search: Search the object's `mask` where one is given, or the whole `image`.
        rotations: Number of copies of both images, rotated by quarter turns, that are averaged: 1,
            2 or 4.
        mirrored: Average mirrored copies of both images too, with half the weight of the others: a
            mirrored blank cloth looks like the same cloth turned over.
        rectify: Answer in views from straight above (`baselines/tracing/reframing.py`). With
            `trace`, if the widths of a rope's mask show that the camera was tilted; otherwise, if
            the network is more confident in that view.
        fill: If the object's box takes less than the first share of the frame's width or height,
            whichever is more, the picture is cropped so that it takes the second share.
        blank_square: Whether the object is a blank square, whose sides look alike. `upright`: its
            orientation in the picture distinguishes the sides, unless it is rotated by more than
            in the training data. `any`: nothing distinguishes them, and an answer has the four
            positions as modes. With either, a rotated cloth is first set upright, if the network
            is then more confident.
        one_side: Answer all points of a cloth on the side that most of the pair agrees on, see
            `models/don/sides.py`.
        plain_table: Replace the picture outside of the mask by the local mean colour of the table.
            For cloths; it does not improve answers on ropes.
        crossings: With `trace`: decide which strand is on top where a rope crosses itself, with a
            small network trained at the end of the run (`models/don/crossing_training.py`).
        distribution: Distribution in the answers: `modes` or `none`.
    """

    decode: Literal["argmax", "median", "soft", "trace"] = "median"
    search: Literal["mask", "image"] = "mask"
    margin_px: Natural = 0
    rotations: Literal[1, 2, 4] = 1
    mirrored: bool = False
    rectify: bool = False
    fill: Annotated[Range, Bounds(0, 1, above=True)] = (0.54, 0.74)
    blank_square: Literal["no", "upright", "any"] = "no"
    one_side: bool = False
    plain_table: bool = False
    crossings: bool = False
    distribution: Literal["modes", "none"] = "modes"


class FurtherSet(NamedTuple):
    """An entry of `also`: a dataset and a tier; an empty one is that of the run."""

    data: str
    tier: str

    @classmethod
    def parse(cls, entry: str) -> Self:
        """Read `DATA#TIER`, either part of which may be left out."""
        data, _, tier = entry.partition("#")
        return cls(data, tier)

    def __str__(self) -> str:
        return f"{self.data}#{self.tier}".rstrip("#")


class DonSettings(RunSettings):
    """A whole run of Dense Object Nets.

    Attributes:
        pairs: Training samples.
        augment: Data augmentation.
        network: The network.
        loss: The loss.
        validation: Validation during the run.
        answer: Inference.
        also: Further training data, `DATA#TIER` each; either part may be omitted and is then
            that of the run. The frames of a pair are of one dataset and tier.
    """

    pairs: PairSettings = PairSettings()
    augment: AugmentSettings = AugmentSettings()
    network: NetworkSettings = NetworkSettings()
    loss: LossSettings = LossSettings()
    validation: PairValidationSettings = PairValidationSettings()
    answer: AnswerSettings = AnswerSettings()
    also: tuple[str, ...] = ()

    @property
    def further(self) -> list[FurtherSet]:
        """The entries of `also`."""
        return [FurtherSet.parse(entry) for entry in self.also]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.loss.time_weight > 0 and self.pairs.pairing == "any":
            raise Refused(
                "'sequence' or 'next' for loss.time_weight above 0",
                "pairs.pairing",
                "Add --set pairs.pairing=next",
            )
        if self.answer.crossings and self.answer.decode != "trace":
            raise Refused("'trace' while answer.crossings is true", "answer.decode")
        if self.augment.picture_drop > 0 and not (
            self.pairs.network_input.colour and self.pairs.masks
        ):
            raise Refused(
                "0 unless the network sees a colour or grey picture and masks",
                "augment.picture_drop",
            )
        return self
