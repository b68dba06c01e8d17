"""The config of a TimeCycle run: frozen, self-checking, YAML in and the same out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from pliant.loaders.augment import AugmentSettings
from pliant.models.resnet import DEPTHS
from pliant.models.settings import OptimiserSettings, RunSettings

ENCODERS = ("small", *DEPTHS)


@dataclass(frozen=True)
class EncoderSettings:
    """The network that gives every cell of an image a descriptor.

    Attributes:
        name: `small` (for CPUs), or `resnet18`, `resnet34`, `resnet50` up to their third stage
            at stride 1, all of stride 8.
        dim: Channels D of a cell's unit descriptor.
        widths: Small: channels of its three stages.
        pretrained: First weights of a ResNet: a file, `hub:REPO:NAME`, `timm:NAME`, or nothing.
    """

    name: Literal["small", "resnet18", "resnet34", "resnet50"] = "small"
    dim: int = 64
    widths: tuple[int, ...] = (32, 64, 96)
    pretrained: str = ""

    def __post_init__(self) -> None:
        if self.dim < 1 or len(self.widths) != 3 or min(self.widths) < 8:
            raise ValueError("encoder: dim >= 1 and three widths of at least 8 are required")
        if any(width % 8 for width in self.widths):
            raise ValueError("encoder.widths must be multiples of 8")
        if self.pretrained and self.name == "small":
            raise ValueError("encoder.pretrained needs a ResNet")


@dataclass(frozen=True)
class LocaliserSettings:
    """What reads a place off the affinities between a patch and a frame.

    Attributes:
        kind: `moments`: the rigid motion that best fits where each cell of the patch is expected
            (no weights); `conv`: the paper's convolutions and linear layer.
        widths: Conv: channels of its two convolutions.
        kernel: Conv: side of the first convolution, 3 (the paper) or 1 (cheap).
    """

    kind: Literal["moments", "conv"] = "moments"
    widths: tuple[int, int] = (128, 64)
    kernel: int = 3

    def __post_init__(self) -> None:
        if min(self.widths) < 1 or self.kernel not in (1, 3):
            raise ValueError("localiser: widths >= 1 and kernel 1 or 3 are required")


@dataclass(frozen=True)
class ClipSettings:
    """What a training clip is.

    Attributes:
        length: Frames T of a clip; cycles go 1 to T - 1 frames back.
        step: Episode frames from one clip frame to the next, at least.
        step_max: At most; drawn for each clip.
        patches: Patches a clip.
        patch: Side of a patch as a share of the frame's shorter side.
        choose: Where patches come from: the object's `mask` (truth), what moves (`motion`) or
            `anywhere`.
        turn_deg: A patch is turned by up to this much before it is sought.
        recolour: Gain and offset of each of its channels vary by about this share.
    """

    length: int = 4
    step: int = 1
    step_max: int = 6
    patches: int = 2
    patch: float = 1 / 3
    choose: Literal["mask", "motion", "anywhere"] = "mask"
    turn_deg: float = 30.0
    recolour: float = 0.1

    def __post_init__(self) -> None:
        if not 0 <= self.recolour <= 1:
            raise ValueError("clips.recolour must be 0 to 1")
        if self.length < 2 or not 1 <= self.step <= self.step_max or self.patches < 1:
            raise ValueError("clips: length >= 2, 1 <= step <= step_max, patches >= 1")
        if not 0 < self.patch <= 0.75 or not 0 <= self.turn_deg <= 180:
            raise ValueError("clips: patch must be above 0 up to 0.75, turn_deg 0 to 180")


@dataclass(frozen=True)
class CycleLossSettings:
    """What is minimised. Each part has its own name in the log.

    Attributes:
        temperature: Of the affinity's softmax; 0 takes the paper's D^-0.5.
        cycle: How a cycle's end is judged: `grid`, the squared distance of the two placements
            on an aligned grid, or `inlier`, how little of the affinity lies where it belongs.
        grid: Points of the aligned grid along a side.
        inlier_cells: Spread of the soft inlier count, cells.
        similarity: Weight of -<patch, what was found>.
        skip: Weight of cycles to a frame and straight back.
        long: Weight of cycles through every frame between.
        self_cycle: Weight of finding a changed patch in its own frame.
        freeze: Share of the steps in which the encoder stays as it is (the localiser warms up).
    """

    temperature: float = 0.0
    cycle: Literal["grid", "inlier"] = "grid"
    grid: int = 20
    inlier_cells: float = 1.0
    similarity: float = 1.0
    skip: float = 0.1
    long: float = 0.02
    self_cycle: float = 1.0
    freeze: float = 0.0

    def __post_init__(self) -> None:
        if self.temperature < 0 or self.grid < 2 or not self.inlier_cells > 0:
            raise ValueError("losses: temperature >= 0, grid >= 2, inlier_cells > 0 are required")
        weights = (self.similarity, self.skip, self.long, self.self_cycle)
        if min(weights) < 0 or not any(weights):
            raise ValueError("losses: weights must be >= 0, and one of them above 0")
        if not 0 <= self.freeze < 1:
            raise ValueError("losses.freeze must be 0 to 1")


@dataclass(frozen=True)
class PropagationSettings:
    """How points are carried through frames.

    Attributes:
        temperature: Of the softmax over the cells that compete; 0 takes the training one.
        top_k: So many best cells compete (times refine squared finer ones).
        context: Frames before this one that tell what the point looks like, besides the first.
        first_weight: Weight of the first frame among them, 0 to 1.
        radius: Cells this far from the last place may be the next one, a share of the frame's
            longer side; 0 for all.
        prior: Standard deviation, cells, of a Gaussian about the last place that weighs the
            cells; 0 for none.
        refine: Descriptors are interpolated this many times finer before they are compared.
        search: Cells on the object's `mask` where one is given out, or the whole `image`.
    """

    temperature: float = 0.0
    top_k: int = 10
    context: int = 7
    first_weight: float = 0.25
    radius: float = 0.1
    prior: float = 2.5
    refine: int = 2
    search: Literal["mask", "image"] = "image"

    def __post_init__(self) -> None:
        if self.temperature < 0 or self.top_k < 1 or self.context < 0 or self.refine < 1:
            raise ValueError(
                "propagation: temperature and context >= 0, top_k and refine >= 1 are required"
            )
        if not 0 <= self.first_weight <= 1 or min(self.radius, self.prior) < 0:
            raise ValueError("propagation: first_weight must be 0 to 1, radius and prior >= 0")
        if self.context == 0 and self.first_weight == 0:
            raise ValueError("propagation: without context the first frame must have a weight")


@dataclass(frozen=True)
class TrackValidationSettings:
    """How a run is watched.

    Attributes:
        split: Split of the validation episodes.
        every: Steps between validations.
        clips: Stretches of episodes that are tracked.
        frames: Frames after the first one of each.
        queries: Points of a stretch.
        patience: Validations without a lower error after which to stop; 0 never stops.
    """

    split: str = "val"
    every: int = 200
    clips: int = 8
    frames: int = 20
    queries: int = 32
    patience: int = 0

    def __post_init__(self) -> None:
        if min(self.every, self.clips, self.frames, self.queries) < 1 or self.patience < 0:
            raise ValueError("validation: every, clips, frames, queries >= 1, patience >= 0")


@dataclass(frozen=True)
class TimeCycleSettings(RunSettings):
    """A whole run of TimeCycle.

    Attributes:
        kind: What the run is; `load_matcher` reads it.
        clips: What a clip is.
        augment: What happens to a clip, the same to all its frames.
        encoder: The encoder.
        localiser: The localiser.
        losses: The losses.
        optimiser: The optimiser.
        validation: How the run is watched.
        propagation: How the result answers.
    """

    kind: Literal["timecycle"] = "timecycle"
    width: int = 320
    height: int = 240
    steps: int = 800
    batch: int = 4
    checkpoint_every: int = 100
    clips: ClipSettings = field(default_factory=ClipSettings)
    augment: AugmentSettings = field(default_factory=AugmentSettings)
    encoder: EncoderSettings = field(default_factory=EncoderSettings)
    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)
    losses: CycleLossSettings = field(default_factory=CycleLossSettings)
    optimiser: OptimiserSettings = field(default_factory=OptimiserSettings)
    validation: TrackValidationSettings = field(default_factory=TrackValidationSettings)
    propagation: PropagationSettings = field(default_factory=PropagationSettings)

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if not 32 <= getattr(self, name) <= 4096 or getattr(self, name) % 8:
                raise ValueError(f"{name} must be a multiple of 8 from 32 to 4096")
        super().__post_init__()
        if self.losses.freeze and self.localiser.kind == "moments":
            raise ValueError("losses.freeze needs localiser.kind conv: moments learn nothing")

    @property
    def patch_cells(self) -> int:
        """Cells along a side of a patch."""
        return max(2, round(self.clips.patch * min(self.width, self.height) / 8))

    @property
    def temperature(self) -> float:
        """Temperature of the affinity's softmax."""
        return self.losses.temperature or self.encoder.dim**-0.5
