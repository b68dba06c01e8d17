"""What a dataset is made from: one frozen, self-checking config, in YAML, JSON or flags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from pliant.generator.settings import settings_from, settings_to_dict
from pliant.spec.conventions import SPLITS
from pliant.spec.errors import CallError
from pliant.spec.yamlfiles import read_yaml, yaml_text

TIER_KINDS: Final[dict[str, str]] = {
    "rope": "rope",
    "cloth-1": "cloth",
    "cloth-2": "cloth",
    "cloth-3": "cloth",
}
"""Every tier that can be generated, in the order a dataset lists them, and its kind."""

STYLES: Final = ("fast", "photo", "raster", "real-depth")

BLENDER_STYLES: Final = ("fast", "photo")
"""Styles that Blender renders, on a GPU where there is one."""

QUERY_KINDS: Final = ("pairs", "track")

DEFAULT_SEQUENCES: Final = 20

_SPLIT_CYCLE: Final = (
    "train",
    "test",
    "train",
    "test",
    "val",
    "train",
    "train",
    "train",
    "train",
    "train",
)
# Which split the k-th sequence of a tier joins (k modulo 10): 70 % train, 10 % val, 20 % test.
# The split of a sequence thus never changes when a set grows.

GROWING_FIELDS: Final = ("tiers", "splits")
"""Fields that may grow on a set that exists."""

LABEL_FIELDS: Final = ("id", "version", "title", "description", "licence")
"""Fields that only `dataset.json` shows; they may change on a set that exists."""


@dataclass(frozen=True)
class QuerySettings:
    """How many queries the frozen benchmark asks.

    Attributes:
        pairs_per_sequence: Image pairs whose target lies in one sequence, >= 1.
        queries_per_pair: Query points of a pair, >= 1 (fewer where fewer points are visible).
        splits: Splits that get queries.
        kind: `pairs`, or for episodes `track`: the points of frame 0 in every later frame;
            `pairs_per_sequence` then does not apply.
    """

    pairs_per_sequence: int = 4
    queries_per_pair: int = 64
    splits: tuple[str, ...] = ("val", "test")
    kind: str = "pairs"

    def __post_init__(self) -> None:
        _require(self.kind in QUERY_KINDS, "queries.kind", self.kind, " or ".join(QUERY_KINDS))
        for name in ("pairs_per_sequence", "queries_per_pair"):
            _require(getattr(self, name) >= 1, f"queries.{name}", getattr(self, name), ">= 1")
        for split in self.splits:
            _require(split in SPLITS, "queries.splits", split, "one of " + ", ".join(SPLITS))


@dataclass(frozen=True)
class GenerateConfig:
    """Everything that decides the bytes of a generated dataset.

    Attributes:
        tiers: Tier names, keys of `TIER_KINDS`; kept in that order.
        sequences: Sequences per tier, >= 1, shared out over the splits by a fixed cycle of ten
            (7 train, 1 val, 2 test). Not given together with `splits`; neither means 20.
        splits: Split -> sequences per tier, as an alternative to `sequences`.
        frames: Frames per sequence, >= 1.
        episodes: True for episodes (frames in time), False for independent configurations.
        width: Image width, px, 16 to 8192.
        height: Image height, px, 16 to 8192.
        seed: Seed of everything, 0 to 2^63 - 1; 0 is a seed like any other.
        style: `fast`, `photo`, `raster` or `real-depth`.
        rope: Settings of the rope tier (`RopeSettings`), as a mapping.
        cloth: Settings of the cloth tiers (`ClothSettings`), as a mapping.
        look: Ranges of table, light, colour (`LookSettings`), as a mapping.
        camera: Ranges of the camera (`CameraSettings`), as a mapping.
        noise: Image noise (`NoiseSettings`), as a mapping; None adds none.
        depth_camera: Faults that the style `real-depth` shows (`DepthCameraSettings`), as a
            mapping; None takes its defaults. Of no other style.
        queries: The benchmark's queries.
        id: Dataset id.
        version: Dataset version.
        title: One line for people; empty makes one from the tiers.
        description: A paragraph for people; empty makes one from the config.
        licence: Licence of the data, SPDX.
    """

    tiers: tuple[str, ...]
    sequences: int | None = None
    splits: Mapping[str, int] | None = None
    frames: int = 1
    episodes: bool = False
    width: int = 640
    height: int = 480
    seed: int = 0
    style: str = "fast"
    rope: Mapping[str, Any] = field(default_factory=dict)
    cloth: Mapping[str, Any] = field(default_factory=dict)
    look: Mapping[str, Any] = field(default_factory=dict)
    camera: Mapping[str, Any] = field(default_factory=dict)
    noise: Mapping[str, Any] | None = None
    depth_camera: Mapping[str, Any] | None = None
    queries: QuerySettings = field(default_factory=QuerySettings)
    id: str = "pliant"
    version: str = "1.0.0"
    title: str = ""
    description: str = ""
    licence: str = "CC-BY-4.0"

    def __post_init__(self) -> None:
        self._check_tiers()
        self._check_splits()
        _require(self.frames >= 1, "frames", self.frames, ">= 1")
        _require(
            not self.episodes or self.frames >= 2,
            "frames",
            self.frames,
            ">= 2 for episodes (--frames)",
        )
        _require(
            self.episodes or self.queries.kind != "track",
            "queries.kind",
            self.queries.kind,
            "pairs, or --episodes: only an episode can be tracked",
        )
        for name in ("width", "height"):
            _require(16 <= getattr(self, name) <= 8192, name, getattr(self, name), "16 to 8192")
        _require(0 <= self.seed < 2**63, "seed", self.seed, "0 to 2^63 - 1")
        _require(self.style in STYLES, "style", self.style, "one of " + ", ".join(STYLES))
        _require(bool(self.id), "id", repr(self.id), "a name")
        _require(
            self.depth_camera is None or self.style == "real-depth",
            "style",
            self.style,
            "real-depth, whose settings depth_camera holds",
        )
        for name in ("rope", "cloth", "look", "camera", "noise", "depth_camera"):
            values = getattr(self, name)
            if values or not isinstance(values, Mapping | None):
                self.section(name)

    def _check_tiers(self) -> None:
        _require(bool(self.tiers), "tiers", "none", "one of " + ", ".join(TIER_KINDS))
        for tier in self.tiers:
            _require(tier in TIER_KINDS, "tiers", tier, "one of " + ", ".join(TIER_KINDS))
        object.__setattr__(self, "tiers", tuple(t for t in TIER_KINDS if t in self.tiers))

    def _check_splits(self) -> None:
        if self.splits is None:
            total = DEFAULT_SEQUENCES if self.sequences is None else self.sequences
            _require(total >= 1, "sequences", total, ">= 1")
            counts = split_counts(total)
        else:
            _require(
                self.sequences is None,
                "sequences",
                self.sequences,
                "either sequences or splits, not both",
            )
            for split, count in self.splits.items():
                _require(split in SPLITS, "splits", split, "one of " + ", ".join(SPLITS))
                valid = isinstance(count, int) and not isinstance(count, bool) and count >= 0
                _require(valid, f"splits.{split}", count, ">= 0")
            counts = {name: self.splits[name] for name in SPLITS if self.splits.get(name)}
            _require(bool(counts), "splits", "no sequence", "at least one sequence")
        object.__setattr__(self, "splits", counts)
        object.__setattr__(self, "sequences", None)

    @property
    def size(self) -> tuple[int, int]:
        """Image width and height, px."""
        return self.width, self.height

    @property
    def counts(self) -> Mapping[str, int]:
        """Split -> sequences per tier, in the order train, val, test."""
        assert self.splits is not None  # __post_init__ has filled it
        return self.splits

    def section(self, name: str) -> Any:
        """Return the settings of `rope`, `cloth`, `look`, `camera`, `noise` or `depth_camera`.

        Returns:
            The section's dataclass; None for `noise` where the config has none, and for
            `depth_camera` in other styles than `real-depth`.

        Raises:
            CallError: The mapping holds an unknown or refused setting.
        """
        values = getattr(self, name)
        if values is None:
            if name != "depth_camera" or self.style != "real-depth":
                return None
            values = {}
        return settings_from(_section_class(name), values, name)

    def resolved(self) -> dict[str, Any]:
        """Return the config as JSON values with the defaults of its sections filled in.

        `rope` or `cloth` is left out where no tier uses it, `depth_camera` in other styles.
        """
        values = self.to_dict()
        kinds = {TIER_KINDS[tier] for tier in self.tiers}
        for unused in {"rope", "cloth"} - kinds:
            del values[unused]
        depth = ("depth_camera",) if self.style == "real-depth" else ()
        for name in (*kinds, "look", "camera", "noise", *depth):
            values[name] = settings_to_dict(self.section(name))
        return values

    def to_dict(self) -> dict[str, Any]:
        """Return the config as JSON values; `from_dict` gives an equal config back."""
        values: dict[str, Any] = settings_to_dict(self)
        del values["sequences"]
        if self.depth_camera is None:
            del values["depth_camera"]
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> GenerateConfig:
        """Build a config from JSON values.

        Raises:
            CallError: An unknown key or a value that is refused; it names the field.
        """
        if "tiers" not in values:
            raise CallError(
                "the config names no tier", where="tiers", fix="Add, for example: tiers: [rope]"
            )
        return settings_from(cls, values, "")

    @classmethod
    def from_file(cls, path: Path, **changes: Any) -> GenerateConfig:
        """Read a YAML or JSON config.

        Args:
            path: The file.
            changes: Fields that replace the file's.

        Raises:
            CallError: The file cannot be read, or a field is refused.
        """
        return cls.from_dict({**read_config_file(path), **changes})

    def to_yaml(self) -> str:
        """Return the config as YAML text."""
        return yaml_text(self.to_dict())

    def with_changes(self, **changes: Any) -> GenerateConfig:
        """Return a copy with some fields replaced."""
        return replace(self, **changes)


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


def read_config_file(path: Path) -> dict[str, Any]:
    """Read a config file's mapping, YAML or JSON by its name, without checking its fields.

    Raises:
        CallError: The file is missing, is not YAML or JSON, or is no mapping.
    """
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise CallError(
            "the config must be a mapping of fields", path=path, found=type(values).__name__
        )
    return values


def _require(valid: bool, where: str, found: object, required: str) -> None:
    if not valid:
        raise CallError("the setting is not possible", where=where, found=found, required=required)


def _section_class(name: str) -> type[Any]:
    # Imported when a section is named: these modules bring numba, and `pliant generate` on a
    # finished set answers without it.
    if name == "rope":
        from pliant.generator.rope import RopeSettings

        return RopeSettings
    if name == "cloth":
        from pliant.generator.cloth import ClothSettings

        return ClothSettings
    if name == "look":
        from pliant.generator.look import LookSettings

        return LookSettings
    if name == "camera":
        from pliant.generator.camera import CameraSettings

        return CameraSettings
    if name == "depth_camera":
        from pliant.generator.render.depth_camera import DepthCameraSettings

        return DepthCameraSettings
    from pliant.generator.noise import NoiseSettings

    return NoiseSettings
