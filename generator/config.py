"""What a dataset is made from: one frozen, self-checking config, in YAML, JSON or flags."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, Self, get_args

from pydantic import model_validator

from pliant.generator.settings import (
    AppearanceSettings,
    CameraSettings,
    ClothSettings,
    DepthCameraSettings,
    NoiseSettings,
    RopeSettings,
    SceneSettings,
)
from pliant.spec.configuration import Settings, settings_to_dict
from pliant.spec.constraints import (
    Bounds,
    Count,
    Name,
    Natural,
    NotEmpty,
    OneOf,
    Refused,
    Share,
    Shown,
    Version,
)
from pliant.spec.conventions import SPLITS
from pliant.spec.io import limits
from pliant.spec.secrets import GUESSABLE_BELOW

TIER_KINDS: Final[dict[str, str]] = {
    "rope": "rope",
    "cloth-1": "cloth",
    "cloth-2": "cloth",
    "cloth-3": "cloth",
    "towel": "cloth",
}
"""Every tier that can be generated, in the order a dataset lists them, and its kind."""

Style = Literal["fast", "photo", "raster", "real-depth"]
STYLES: Final[tuple[Style, ...]] = get_args(Style)

SplitName = Annotated[str, OneOf(SPLITS)]

BLENDER_STYLES: Final = ("fast", "photo")
"""Styles that Blender renders, on a GPU where there is one."""

DEFAULT_SEQUENCES: Final = 20

LONGEST_EPISODE: Final = 3000
"""Frames of an episode of a rope; the physics is checked up to here."""

_SPLIT_CYCLE: Final = ("train", "test") * 2 + ("val",) + ("train",) * 5
# Which split the k-th sequence of a tier joins (k modulo 10): 70 % train, 10 % val, 20 % test.
# The split of a sequence thus never changes when a set grows.

GROWING_FIELDS: Final = ("tiers", "splits")
"""Fields that may grow on a set that exists."""

LABEL_FIELDS: Final = ("id", "version", "title", "description", "licence")
"""Fields that only `dataset.json` shows; they may change on a set that exists."""


class QuerySettings(Settings):
    """How many queries the frozen benchmark asks.

    Attributes:
        pairs_per_sequence: Image pairs whose target is in one sequence, >= 1.
        queries_per_pair: Query points of a pair, >= 1 (fewer where fewer points are visible).
        splits: Splits that get queries.
        kind: `pairs`, or for episodes `track`: the points of frame 0 in every later frame;
            `pairs_per_sequence` then does not apply.
        skips: Episodes: each source is asked in the frames that are so many later, and no target
            is ever a source. None asks about any two frames.
        moving_share: Episodes: at least this share of a source's points moves by more than 4 px
            on its way to the targets (fewer points are asked where too few move).
    """

    pairs_per_sequence: Count = 4
    queries_per_pair: Count = 64
    splits: tuple[SplitName, ...] = ("val", "test")
    kind: Literal["pairs", "track"] = "pairs"
    skips: tuple[Count, ...] = ()
    moving_share: Share = 0.0


class GenerateConfig(Settings):
    """Everything that decides the bytes of a generated dataset.

    Attributes:
        tiers: Tier names, keys of `TIER_KINDS`; kept in that order.
        sequences: Sequences per tier, >= 1, shared out over the splits by a fixed cycle of ten
            (7 train, 1 val, 2 test). Not given together with `splits`; neither means 20.
        splits: Split -> sequences per tier, as an alternative to `sequences`.
        frames: Frames per sequence, 1 to 100,000; fewer where a sequence would have more than 20
            million rows of correspondences.
        episodes: True for episodes (frames in time), False for independent configurations.
        width: Image width, px, 16 to 8192.
        height: Image height, px, 16 to 8192; at most 2^24 pixels in all.
        seed: Random seed, 0 to 2^63 - 1; 0 is a seed like any other.
        secret_seed: The runner takes a seed of 128 bits from the dataset's private file, which it
            makes where there is none; no public file contains it.
        style: `fast`, `photo`, `raster` or `real-depth`.
        gripper: Episodes: show a gripper that holds the object, and hides parts of it.
        rope: Settings of the rope tier.
        cloth: Settings of the cloth tiers.
        look: Ranges of table, light, colour.
        scene: What else is in the scene; configurations alone.
        camera: Ranges of the camera.
        noise: Image noise; None adds none.
        depth_camera: Faults that the style `real-depth` shows; None takes its defaults. Other
            styles take none.
        queries: The benchmark's queries.
        id: Dataset id.
        version: Dataset version.
        title: One line for people; empty makes one from the tiers.
        description: A paragraph for people; empty makes one from the config.
        licence: Licence of the data, SPDX.
    """

    tiers: Annotated[tuple[Annotated[str, OneOf(TIER_KINDS)], ...], NotEmpty()]
    sequences: Count | None = None
    splits: Mapping[SplitName, Natural] | None = None
    frames: Annotated[int, Bounds(1, limits.MAX_FRAMES)] = 1
    episodes: bool = False
    width: Annotated[int, Bounds(16, 8192, "px")] = 640
    height: Annotated[int, Bounds(16, 8192, "px")] = 480
    seed: Natural = 0
    secret_seed: bool = False
    style: Style = "fast"
    gripper: bool = False
    rope: RopeSettings = RopeSettings()
    cloth: ClothSettings = ClothSettings()
    look: AppearanceSettings = AppearanceSettings()
    scene: SceneSettings = SceneSettings()
    camera: CameraSettings = CameraSettings()
    noise: NoiseSettings | None = None
    depth_camera: DepthCameraSettings | None = None
    queries: QuerySettings = QuerySettings()
    id: Name = "pliant"
    version: Version = "1.0.0"
    title: Shown = ""
    description: Shown = ""
    licence: Shown = "CC-BY-4.0"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.secret_seed and self.seed >= 2**63:
            raise Refused("0 to 2^63 - 1, or --secret-seed", "seed")
        if self.secret_seed and 0 < self.seed < GUESSABLE_BELOW:
            raise Refused("no seed with --secret-seed: the runner draws it", "seed")
        if self.episodes and self.frames < 2:
            raise Refused(">= 2 for episodes (--frames)", "frames")
        if not self.episodes and self.queries.kind == "track":
            raise Refused("pairs, or --episodes: only an episode can be tracked", "queries.kind")
        asked = self.queries
        moving = {"gripper": self.gripper, "queries.skips": asked.skips}
        moving["queries.moving_share"] = asked.moving_share
        for name, value in moving.items():
            if value and not self.episodes:
                raise Refused("an episode (--episodes)", name)
        if asked.skips and (asked.kind == "track" or max(asked.skips) >= self.frames):
            raise Refused(f"kind pairs, and skips below frames ({self.frames})", "queries.skips")
        if self.cloth.sides == "alternate" and self.episodes:
            raise Refused("any for episodes", "cloth.sides")
        if self.scene.distractors[1] and self.episodes:
            raise Refused("(0, 0) for episodes: they simulate one object", "scene.distractors")
        if self.depth_camera is not None and self.style != "real-depth":
            raise Refused("real-depth, the only style with a depth_camera", "style")
        if self.splits is not None and self.sequences is not None:
            raise Refused("either sequences or splits, not both", "sequences")
        counts = self.splits
        if counts is None:
            counts = split_counts(self.sequences or DEFAULT_SEQUENCES)
        counts = {name: counts[name] for name in SPLITS if counts.get(name)}
        if not counts:
            raise Refused("at least one sequence", "splits")
        self._check_limits(sum(counts.values()))
        object.__setattr__(self, "tiers", tuple(t for t in TIER_KINDS if t in self.tiers))
        object.__setattr__(self, "splits", counts)
        object.__setattr__(self, "sequences", None)
        return self

    def _check_limits(self, sequences: int) -> None:
        """Refuse what no reader of the format would accept once it is rendered."""
        if self.width * self.height > limits.MAX_IMAGE_PIXELS:
            most = limits.MAX_IMAGE_PIXELS // self.width
            raise Refused(f"at most {most:,} px at this width", "height")
        if sequences * len(self.tiers) > limits.MAX_SEQUENCES:
            raise Refused(f"at most {limits.MAX_SEQUENCES:,} sequences in all tiers", "splits")
        kinds = {TIER_KINDS[tier] for tier in self.tiers}
        if self.episodes and self.frames > LONGEST_EPISODE and "rope" in kinds:
            raise Refused(
                f"at most {LONGEST_EPISODE:,} for an episode of a rope",
                "frames",
                "Make more episodes instead.",
            )
        points = {"rope": self.rope.points, "cloth": self.cloth.tracked_grid.vertices}
        largest = {"rope": "rope.point_stations", "cloth": "cloth.tracked_a_side"}
        for kind in kinds:
            if points[kind] > limits.MAX_POINTS:
                required = f"a number that gives at most {limits.MAX_POINTS:,} points"
                raise Refused(required, largest[kind])
            most = limits.MAX_CORRESPONDENCE_ROWS // points[kind]
            if self.frames > most:
                raise Refused(f"at most {most:,}, as there are {points[kind]:,} points", "frames")

    @property
    def public_seed(self) -> int | None:
        """The seed as public files state it, None for a secret one."""
        return None if self.secret_seed else self.seed

    @property
    def size(self) -> tuple[int, int]:
        """Image width and height, px."""
        return self.width, self.height

    @property
    def counts(self) -> Mapping[str, int]:
        """Split -> sequences per tier, in the order train, val, test."""
        assert self.splits is not None  # _check has filled it
        return self.splits

    @property
    def depth_faults(self) -> DepthCameraSettings | None:
        """Faults of the style `real-depth`, None in other styles."""
        if self.style != "real-depth":
            return None
        return self.depth_camera or DepthCameraSettings()

    def resolved(self) -> dict[str, Any]:
        """Return what decides the bytes of the dataset, as JSON values.

        `rope` or `cloth` is left out where no tier uses it, `depth_camera` in other styles, and
        `scene` where there is nothing else in it.
        """
        values = self.to_dict()
        for unused in {"rope", "cloth"} - {TIER_KINDS[tier] for tier in self.tiers}:
            del values[unused]
        if not self.scene.distractors[1]:
            del values["scene"]
        if self.depth_faults is None:
            del values["depth_camera"]
        else:
            values["depth_camera"] = settings_to_dict(self.depth_faults)
        return values

    def to_dict(self) -> dict[str, Any]:
        """Return the config as JSON values; `settings_from` gives an equal config back.

        A secret seed is left out.
        """
        values: dict[str, Any] = settings_to_dict(self)
        del values["sequences"]
        if self.secret_seed:
            del values["seed"]
        return values


def split_counts(sequences: int) -> dict[str, int]:
    """Share sequences out over the splits.

    Args:
        sequences: Sequences of one tier, >= 1.

    Returns:
        Split -> count, splits without a sequence left out. No count ever falls when
        `sequences` rises.
    """
    joined = [_SPLIT_CYCLE[k % len(_SPLIT_CYCLE)] for k in range(sequences)]
    return {split: joined.count(split) for split in SPLITS if split in joined}
