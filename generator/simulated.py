"""A dataset without files: its sequences are simulated and rendered when a frame is read."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final

import pyarrow as pa

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.runner.dataset_files import describe_dataset
from pliant.generator.runner.plan import plan_tasks
from pliant.generator.runner.run import required_packages
from pliant.generator.runner.sequence import SequenceMaker, tool_versions
from pliant.generator.runner.sequence_writer import correspondence_rows, point_rows
from pliant.generator.seeding import SequenceTask
from pliant.spec.arrays import Rgb
from pliant.spec.camera import Camera
from pliant.spec.configuration import read_settings, settings_from
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.extras import require_packages
from pliant.spec.io.exr import Surface
from pliant.spec.lru_cache import LRUCache
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage import layout

KEPT_BYTES: Final = 256 * 2**20
"""Most bytes of simulated sequences that a process keeps; a larger one is kept alone."""

_NEVER_WRITTEN: Final = (layout.mask_name(0), layout.camera_depth_name(0))


@dataclass(frozen=True)
class SimulatedFrames:
    """A sequence in memory, with the values that its files would have.

    Attributes:
        rgb: uint8 (H, W, 3) of each frame.
        surfaces: Surface image of each frame.
        correspondences: Where the points are in each frame.
        points: The material points.
        camera: The camera of all frames.
    """

    rgb: tuple[Rgb, ...]
    surfaces: tuple[Surface, ...]
    correspondences: tuple[pa.Table, ...]
    points: pa.Table
    camera: Camera

    @property
    def nbytes(self) -> int:
        """Memory of its arrays, bytes."""
        images = sum(each.nbytes for each in self.rgb)
        tables = sum(each.nbytes for each in self.correspondences)
        planes = sum(
            plane.nbytes for s in self.surfaces for plane in (s.depth_m, s.m0, s.m1, s.object_id)
        )
        return images + tables + planes


class Simulator:
    """Takes the place of a dataset's files: simulates a sequence and keeps the last ones.

    Args:
        config: What `pliant generate` would write.
    """

    address = "a simulated dataset"

    def __init__(self, config: GenerateConfig) -> None:
        self.config = config
        # The newest sequence is kept however large it is.
        self._kept = LRUCache[SimulatedFrames](KEPT_BYTES, lambda frames: frames.nbytes, least=1)

    @cached_property
    def _maker(self) -> SequenceMaker:
        """The renderer, opened in the process that first needs a frame."""
        return SequenceMaker(self.config, Path())

    def frames(self, task: SequenceTask) -> SimulatedFrames:
        """Return the frames of a sequence."""
        return self._kept.get(task.id, functools.partial(self._simulate, task))

    def _simulate(self, task: SequenceTask) -> SimulatedFrames:
        shooting = self._maker.shoot(task)
        taken = [(rgb, truth) for rgb, truth, _ in shooting.frames]
        return SimulatedFrames(
            rgb=tuple(rgb for rgb, _ in taken),
            surfaces=tuple(truth.surface for _, truth in taken),
            correspondences=tuple(correspondence_rows(n, t) for n, (_, t) in enumerate(taken)),
            points=point_rows(shooting.scene_object.points),
            camera=shooting.camera,
        )

    def has(self, name: str) -> bool:
        """Return whether there is such a file: there is none."""
        return False

    def get(self, name: str) -> Path:
        """Refuse to return a file."""
        raise SpecError(
            "a simulated dataset has no files", found=name, fix="Write it: pliant generate"
        )

    local = get

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave the renderer and the frames out: another process makes its own."""
        return Simulator, (self.config,)


@dataclass(frozen=True, repr=False)
class SimulatedSequence(SequenceRecord):
    """A sequence whose frames are simulated when one of them is read."""

    files: Simulator = field(repr=False, compare=False)
    made_whole: ClassVar[bool] = True

    @cached_property
    def _task(self) -> SequenceTask:
        return SequenceTask(self.tier, self.split, int(self.id.rsplit("-", 1)[1]))

    @property
    def _simulated(self) -> SimulatedFrames:
        return self.files.frames(self._task)

    def has(self, name: str) -> bool:
        """Return whether `pliant generate` would write such a file."""
        return Path(name).parent not in {Path(each).parent for each in _NEVER_WRITTEN}

    def camera(self, frame: int) -> Camera:
        """Return a frame's camera."""
        self._check(frame)
        return self._simulated.camera

    def rgb(self, frame: int) -> Rgb:
        """Return a frame's colour image, uint8 (H, W, 3), sRGB."""
        self._check(frame)
        return self._simulated.rgb[frame]

    def surface(self, frame: int) -> Surface:
        """Return a frame's depth and surface image."""
        self._check(frame)
        return self._simulated.surfaces[frame]

    def points(self) -> pa.Table:
        """Return the table of material points."""
        return self._simulated.points

    def correspondences(self, frame: int | None = None) -> pa.Table:
        """Return where the points are, of one frame or (None) of all."""
        if frame is None:
            return pa.concat_tables(self._simulated.correspondences)
        self._check(frame)
        return self._simulated.correspondences[frame]


class SimulatedDataset(Dataset):
    """A dataset without files or queries; its frames equal those that `pliant generate` writes."""

    sequence_class: ClassVar = SimulatedSequence

    @classmethod
    def of(cls, config: GenerateConfig | Mapping[str, Any] | Path | str) -> SimulatedDataset:
        """Open the dataset that a config describes; nothing is simulated yet.

        Args:
            config: The config, its values, or its YAML file.

        Raises:
            CallError: The seed is secret: it is known where the dataset is written alone.
            MissingExtraError: The extra `generate` is not installed.
        """
        if isinstance(config, Path | str):
            config = read_settings(GenerateConfig, Path(config), ())
        elif not isinstance(config, GenerateConfig):
            config = settings_from(GenerateConfig, config)
        if config.secret_seed:
            raise CallError("a simulated dataset needs a seed", where="secret_seed", found=True)
        require_packages(required_packages(config.style), "simulating a dataset", "generate")
        tasks, simulator = plan_tasks(config), Simulator(config)
        tiers = {name: describe_tier(config, name) for name in config.tiers}
        tools = tool_versions(config.style)
        infos = [{"split": task.split, "tools": tools} for task in tasks]
        info = describe_dataset(config, list(tiers.values()), infos)
        listing = pa.table(
            {
                "id": [task.id for task in tasks],
                "tier": [task.tier for task in tasks],
                "split": [task.split for task in tasks],
                "shape": pa.nulls(len(tasks), pa.string()),
                "frames": [config.frames] * len(tasks),
                "temporal": [config.episodes] * len(tasks),
            }
        )
        return cls(Path(simulator.address), info, tiers, listing, simulator)

    def fingerprint(self) -> bytes:
        """Return `info`: it contains the config, which determines the sequences."""
        return json.dumps(self.info, sort_keys=True).encode()
