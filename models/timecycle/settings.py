"""Settings of a TimeCycle run."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from pliant.loaders.augment import AugmentSettings
from pliant.loaders.inputs import IMAGE_CHANNELS, NetworkInput
from pliant.models.networks.descriptor_network import NetworkSettings
from pliant.models.training.settings import BatchSize, RunSettings, ValidationSettings
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds, Count, Natural, NonNegative, Positive, Refused, Share

Stride = Literal[2, 4, 8]


class ClipSettings(Settings):
    """Training clips.

    Attributes:
        length: Frames T of a clip; cycles go 1 to T - 1 frames back.
        step: Episode frames from one clip frame to the next, at least.
        step_max: At most; drawn for each clip.
        patches: Patches per clip.
        patch: Side of a patch as a share of the frame's shorter side.
        choose: Where patches come from: the object's `mask` (truth), or what moves (`motion`).
        turn_deg: A patch is turned by up to this much before it is sought.
        recolour: Gain and offset of each of its channels vary by about this share.
        input: The image that the network sees: `rgb`, `grey` or `contrast`.
        masks: Whether the masks of the queried object and of all objects are input channels too.
    """

    length: Annotated[int, Bounds(2)] = 4
    step: Count = 1
    step_max: int = 6
    patches: Count = 2
    patch: Annotated[float, Bounds(0, 0.75, above=True)] = 1 / 3
    choose: Literal["mask", "motion"] = "mask"
    turn_deg: Annotated[float, Bounds(0, 180)] = 30.0
    recolour: Share = 0.1
    input: Literal["rgb", "grey", "contrast"] = "rgb"
    masks: bool = False

    @property
    def network_input(self) -> NetworkInput:
        """The channels of the network's input."""
        return NetworkInput(self.input, self.masks)

    @property
    def colours(self) -> int:
        """Channels of the picture, which come first."""
        return len(IMAGE_CHANNELS[self.input])

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.step_max < self.step:
            raise Refused(f">= step, {self.step}", "step_max")
        return self


class CycleLossSettings(Settings):
    """The training loss. Each part has its own name in the log.

    Attributes:
        temperature: Temperature of the affinity's softmax; 0 for the paper's D^-0.5.
        similarity: Weight of the negative similarity of a patch and its match.
        skip: Weight of cycles to a frame and straight back.
        long: Weight of cycles through every frame between.
        self_cycle: Weight of finding a changed patch in its own frame.
    """

    temperature: NonNegative = 0.0
    similarity: NonNegative = 1.0
    skip: NonNegative = 0.1
    long: NonNegative = 0.02
    self_cycle: NonNegative = 1.0

    @property
    def any(self) -> bool:
        """Whether a part has a weight."""
        return any((self.similarity, self.skip, self.long, self.self_cycle))


class WalkSettings(Settings):
    """The contrastive walk back to a warped copy, see `models/timecycle/walk.py`.

    Attributes:
        weight: Weight of its two losses; 0 leaves them out.
        walks: Maximum number of walks per clip; they use four times as many pixels of the other
            frame.
        sigma_px: Standard deviation of the target, network pixels.
        turn_deg: Copies are turned by up to this much either way.
        scale: Their relative size is log-uniform within 1/(1 + scale) to 1 + scale.
        shift: They are moved by up to this share of the frame's size.
        bend_px: Standard deviation of their bends, network pixels, at most.
        knots: Places along the width between which bends are interpolated.
    """

    weight: NonNegative = 0.0
    walks: Count = 96
    sigma_px: Positive = 2.0
    turn_deg: Annotated[float, Bounds(0, 180)] = 180.0
    scale: Share = 0.25
    shift: Annotated[float, Bounds(0, 0.5)] = 0.1
    bend_px: NonNegative = 6.0
    knots: Annotated[int, Bounds(3, 64)] = 6


class PropagationSettings(Settings):
    """Propagation of points through frames.

    Attributes:
        stride: Pixels along a side of a cell.
        temperature: Temperature of the softmax over candidate cells; 0 for that of the training.
        top_k: Number of most similar cells that are candidates (times refine squared).
        context: Earlier frames that show the point's appearance, in addition to the first.
        first_weight: Weight of the first frame among them, 0 to 1.
        radius: Cells this far from the last place may be the next one, a share of the frame's
            longer side; 0 for all.
        prior: Standard deviation, cells, of a Gaussian about the last place that weighs the
            cells; 0 for none.
        smooth: Smooth the motion over neighbouring points: standard deviation, cells, of the
            Gaussian that weights neighbours by distance; 0 for none. Needs the object's mask.
        refine: Descriptors are interpolated this many times finer before they are compared.
        search: Cells on the object's `mask` where one is given out, or the whole `image`.
        chosen: At the end of the training, choose `prior`, `temperature` and `first_weight` on the
            validation split (`models/timecycle/validation.py`); the run's config then has them.
    """

    stride: Stride = 8
    temperature: NonNegative = 0.0
    top_k: Count = 10
    context: Natural = 7
    first_weight: Share = 0.25
    radius: NonNegative = 0.1
    prior: NonNegative = 2.5
    smooth: NonNegative = 0.0
    refine: Count = 2
    search: Literal["mask", "image"] = "image"
    chosen: bool = False

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.context == 0 and self.first_weight == 0:
            raise Refused("above 0 without context frames", "first_weight")
        return self


class TrackValidationSettings(ValidationSettings):
    """How a run of TimeCycle is watched.

    Attributes:
        every: Steps between validations.
        clips: Stretches of episodes that are tracked.
        frames: Frames after the first one of each.
        queries: Points of a stretch.
    """

    every: Count = 200
    clips: Count = 8
    frames: Count = 20
    queries: Count = 32


class TimeCycleSettings(RunSettings):
    """A whole run of TimeCycle.

    Attributes:
        kind: What the run is; `load_matcher` reads it.
        clips: What a clip is.
        augment: What happens to a clip, the same to all its frames.
        network: The encoder: any network of Dense Object Nets, or a trained one
            (`network.pretrained`).
        lift: Length of a constant channel that descriptors have before they are brought to unit
            length. If it is long, their products follow their distances, which is what Dense
            Object Nets are trained with; 0 for none.
        stride: Pixels along a side of a cell in training; the cells' descriptors are means.
        losses: The losses of cycles.
        walk: The losses of walks back to warped copies.
        validation: How the run is watched.
        propagation: How the result answers.
    """

    kind: Literal["timecycle"] = "timecycle"
    width: Annotated[int, Bounds(32, 4096, "px", multiple_of=8)] = 320
    height: Annotated[int, Bounds(32, 4096, "px", multiple_of=8)] = 240
    steps: Count = 800
    batch: BatchSize = 4
    checkpoint_every: Count = 100
    clips: ClipSettings = ClipSettings()
    augment: AugmentSettings = AugmentSettings()
    network: NetworkSettings = NetworkSettings()
    lift: NonNegative = 0.0
    stride: Stride = 8
    losses: CycleLossSettings = CycleLossSettings()
    walk: WalkSettings = WalkSettings()
    validation: TrackValidationSettings = TrackValidationSettings()
    propagation: PropagationSettings = PropagationSettings()

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.losses.any and self.walk.weight == 0:
            raise Refused(
                "one weight above 0 of similarity, skip, long, self_cycle and walk.weight",
                "losses.similarity",
            )
        return self

    @property
    def patch_cells(self) -> int:
        """Cells along a side of a patch."""
        return max(2, round(self.clips.patch * min(self.width, self.height) / self.stride))

    @property
    def temperature(self) -> float:
        """Temperature of the affinity's softmax."""
        return self.losses.temperature or self.network.descriptor_dim**-0.5
