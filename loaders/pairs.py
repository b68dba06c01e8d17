"""`PairDataset`: views of one object in different shapes, and where the same points are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Final, Literal

import numpy as np
import numpy.typing as npt
import torch

from pliant.loaders.augment import (
    AugmentSettings,
    augment,
    check_augmentation,
    draw_placement,
    given_masks,
    given_picture,
    renamed,
    symmetry_in_image,
)
from pliant.loaders.frame_store import FrameStore, check_store
from pliant.loaders.inputs import InputKind, NetworkInput
from pliant.loaders.order import DrawnSamples, check_number, sample_generator
from pliant.loaders.orientation import Orientation
from pliant.loaders.views import TrainingFrame, draw_points
from pliant.spec.arrays import Float32Array, IntArray, Mask
from pliant.spec.calls import check_type, check_whole
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds, Count
from pliant.spec.errors import CallError
from pliant.spec.model import SQUARE_MIRRORS, SQUARE_ROTATIONS

Pairing = Literal["any", "sequence", "next"]

MIXING_STREAM: Final = 2
"""Random stream that chooses among datasets; 0 and 1 draw training and validation samples."""


class PairSettings(Settings):
    """What one sample holds.

    Attributes:
        views: Frames in a sample, >= 2; every ordered pair of them is a training pair.
        queries: Material points in a sample, >= 1.
        pairing: `any` two frames of the tier, two of one `sequence`, or `next` to each other.
        input: The image that the network sees: `rgb`, `grey`, `contrast` or `depth`.
        masks: Whether the masks of the queried object and of all objects are input channels too.

    Examples:
        >>> settings = pliant.loaders.PairSettings(views=3, masks=True)
        >>> store = pliant.loaders.FrameStore(pliant.load("sample"), "rope", "train", (80, 60))
        >>> pliant.loaders.PairDataset(store, settings)[0]["image"].shape
        torch.Size([3, 5, 60, 80])
    """

    views: Annotated[int, Bounds(2)] = 2
    queries: Count = 48
    pairing: Pairing = "any"
    input: InputKind = "rgb"
    masks: bool = False

    @property
    def network_input(self) -> NetworkInput:
        """The channels of the network's input."""
        return NetworkInput(self.input, self.masks)


class PairDataset(DrawnSamples):
    """Any two (or more) frames of a tier and the same material points in each.

    Sample n depends on the seed and n alone, so any order, any number of workers and any
    resumed run see the same samples. Its length is how many samples an epoch is said to have;
    larger numbers are drawn just as well.

    A sample holds (V views, Q queries, S symmetries of the tier):

    * `image` float32 (V, C, h, w), see `NetworkInput.image`;
    * `mask` bool (V, h, w), the queried object; `objects` bool (V, h, w), all objects;
    * `uv_px` float32 (V, Q, 1 + S, 2): slot 0 is the point itself, the others its symmetry
      partners, in working pixels; 0 where unknown;
    * `visible` bool (V, Q, 1 + S);
    * `material` float32 (Q, 1 + S, 2): material coordinates of the points and of their symmetry
      partners;
    * `distance_m` float32 (Q, Q): how far the points are from each other on the material;
    * `orientation` float32 (V, Q, 3), where it was asked for: how the material is oriented,
      see `Orientation`; NaN where unknown;
    * `frames` int64 (V,), numbers in `store.frames`;
    * `action_px` float32 (V, V), the largest distance in the image that any surface point
      visible in both moves between two views of one episode; +inf between others. This is
      the d_action of the temporal Lipschitz loss. Where `pairing` keeps to one sequence,
      augmentation moves all views alike.

    Args:
        store: The frames.
        settings: What a sample holds.
        seed: Seed of the draws.
        augmentation: Random changes, or None.
        orientation: Samples give the orientation.

    Raises:
        CallError: The split has too few frames for the pairing.

    Examples:
        >>> store = pliant.loaders.FrameStore(pliant.load("sample"), "rope", "train", (80, 60))
        >>> sample = pliant.loaders.PairDataset(store)[0]
        >>> sample["image"].shape, sample["uv_px"].shape
        (torch.Size([2, 3, 60, 80]), torch.Size([2, 48, 1, 2]))
    """

    def __init__(
        self,
        store: FrameStore,
        settings: PairSettings | None = None,
        *,
        seed: int = 0,
        augmentation: AugmentSettings | None = None,
        orientation: bool = False,
    ) -> None:
        check_store(store)
        check_type("settings", settings, (PairSettings, type(None)), required="PairSettings")
        check_whole("seed", seed)
        check_augmentation(augmentation)
        self.store, self.settings = store, settings or PairSettings()
        self.seed, self.augmentation = seed, augmentation
        self._symmetries = store.tier.symmetries
        self._blank = bool(self._symmetries) and set(self._symmetries) <= {
            *SQUARE_ROTATIONS,
            *SQUARE_MIRRORS,
        }
        self._orientation: Orientation | None = None
        if orientation:
            self._orientation = Orientation(store.tier.queried, store.material)
        self._groups = self._frames_by_sequence()
        if not self._groups:
            raise CallError(
                f"{store.where} has too few frames for pairs of kind {self.settings.pairing!r}",
                path=store.root,
                required=f"{self.settings.views} frames "
                + ("of one sequence" if self.settings.pairing != "any" else "in all"),
            )

    def __len__(self) -> int:
        return len(self.store)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        """Draw sample number `index` (any number >= 0)."""
        rng = sample_generator(self.seed, index)
        frames = self._draw_frames(rng)
        views = [self.store.view(frame) for frame in frames]
        action = self._action_px(frames, views)
        if self.augmentation is not None:
            views, factor = self._augmented(rng, views, self.augmentation)
            action = action * np.float32(factor)
        # Points seen in two views or more; last, as augmentation lays an object by all of them.
        twice = np.sum([view.visible for view in views], axis=0) >= 2
        drawn = draw_points(rng, twice, self.settings.queries)
        orbit = np.column_stack([drawn, self.store.partners[drawn]])  # (Q, 1 + S)
        material = self.store.material[orbit].astype(np.float32)  # (Q, 1 + S, 2)
        apart_m = self.store.tier.queried.distance_m(material[:, None, 0], material[None, :, 0])
        extra = {"material": torch.from_numpy(material), "distance_m": torch.from_numpy(apart_m)}
        if self._orientation is not None:
            found = [self._orientation.of(view.uv_px, drawn) for view in views]
            extra["orientation"] = torch.from_numpy(np.stack(found))
        views = [
            replace(view, uv_px=view.uv_px[orbit.ravel()], visible=view.visible[orbit.ravel()])
            for view in views
        ]
        return {**self._tensors(rng, frames, views, action), **extra}

    def _augmented(
        self, rng: np.random.Generator, views: list[TrainingFrame], settings: AugmentSettings
    ) -> tuple[list[TrainingFrame], float]:
        """Return the changed views, and by how much distances between them have grown.

        Frames of one sequence are moved together: were each turned on its own, a point at rest
        would seem to move, and the truth would violate the temporal Lipschitz condition.
        """
        alike = self.settings.pairing != "any"
        groups = [views] if alike else [[view] for view in views]
        moves = [self._symmetry(rng, settings) for _ in groups]
        placements = []
        for group, move in zip(groups, moves, strict=True):
            first = None if move is None else symmetry_in_image(self._symmetries[move])
            placements.append(draw_placement(rng, group, settings, first))
        changed = []
        for group, move, affine in zip(groups, moves, placements, strict=True):
            for view in group:
                moved = augment(rng, view, settings, affine)
                if move is not None:
                    moved = renamed(moved, self.store.partners[:, move])
                changed.append(moved)
        if not alike or placements[0] is None:
            return changed, 1.0
        return changed, abs(float(np.linalg.det(placements[0][:, :2]))) ** 0.5

    def _symmetry(self, rng: np.random.Generator, settings: AugmentSettings) -> int | None:
        """Draw a symmetry of a blank cloth by its number; None leaves a view as it is."""
        if settings.symmetric == 0 or not self._blank or rng.random() >= settings.symmetric:
            return None
        drawn = int(rng.integers(1 + len(self._symmetries)))
        return drawn - 1 if drawn else None

    def _frames_by_sequence(self) -> list[IntArray]:
        if self.settings.pairing == "any":
            enough = len(self.store) >= self.settings.views
            return [np.arange(len(self.store))] if enough else []
        groups: dict[str, list[int]] = {}
        for number, ref in enumerate(self.store.frames):
            if ref.sequence.temporal or self.settings.pairing == "sequence":
                groups.setdefault(ref.sequence.id, []).append(number)
        return [np.array(g) for g in groups.values() if len(g) >= self.settings.views]

    def _draw_frames(self, rng: np.random.Generator) -> IntArray:
        group = self._groups[int(rng.integers(len(self._groups)))]
        if self.settings.pairing == "next":
            start = int(rng.integers(len(group) - self.settings.views + 1))
            return group[start : start + self.settings.views]
        return rng.choice(group, size=self.settings.views, replace=False)

    def _action_px(self, frames: IntArray, views: list[TrainingFrame]) -> Float32Array:
        action = np.full((len(views), len(views)), np.inf, dtype=np.float32)
        refs = [self.store.frames[frame] for frame in frames]
        for a, view_a in enumerate(views):
            for b, view_b in enumerate(views):
                same = refs[a].sequence.id == refs[b].sequence.id and refs[a].sequence.temporal
                both = view_a.visible & view_b.visible
                if same and both.any():
                    moved = np.linalg.norm(view_a.uv_px[both] - view_b.uv_px[both], axis=1)
                    action[a, b] = moved.max()
        return action

    def _tensors(
        self,
        rng: np.random.Generator,
        frames: IntArray,
        views: list[TrainingFrame],
        action: Float32Array,
    ) -> dict[str, torch.Tensor]:
        slots = 1 + len(self.store.tier.symmetries)
        images = [self._image(rng, view) for view in views]
        shape = (len(views), self.settings.queries, slots)
        visible = np.stack([view.visible for view in views]).reshape(shape)
        uv = np.stack([view.uv_px for view in views]).reshape(*shape, 2)
        sample: Mapping[str, npt.NDArray[Any]] = {
            "image": np.stack(images),
            "mask": np.stack([view.mask for view in views]),
            "objects": np.stack([view.objects for view in views]),
            "uv_px": np.nan_to_num(uv, nan=0.0, posinf=0.0, neginf=0.0),
            "visible": visible & np.isfinite(uv).all(axis=-1),
            "frames": frames,
            "action_px": action,
        }
        return {name: torch.from_numpy(np.ascontiguousarray(a)) for name, a in sample.items()}

    def _image(self, rng: np.random.Generator, view: TrainingFrame) -> Float32Array:
        seen = self.settings.network_input
        masks: tuple[Mask | None, ...] = (view.mask, view.objects)
        rgb = view.rgb
        if seen.masks and self.augmentation is not None:
            masks = given_masks(rng, view, self.augmentation)
            rgb = given_picture(rng, rgb, masks[0], self.augmentation)
        return seen.image(rgb, view.depth_m, *masks)


class MixedPairs(DrawnSamples):
    """Samples of several datasets: each batch is of one of them, drawn by its number of frames.

    Samples of tiers with and without symmetries have other shapes, and do not mix in a batch.

    Args:
        parts: The datasets.
        seed: Seed of the draws.
        batch: Samples of a batch, >= 1, as in `StepOrder`.

    Examples:
        >>> store = pliant.loaders.FrameStore(pliant.load("sample"), "rope", "train", (80, 60))
        >>> pairs = [pliant.loaders.PairDataset(store, seed=seed) for seed in (1, 2)]
        >>> pliant.loaders.MixedPairs(pairs)[7]["image"].shape
        torch.Size([2, 3, 60, 80])
    """

    def __init__(self, parts: Sequence[PairDataset], seed: int = 0, batch: int = 1) -> None:
        check_type("parts", parts, (list, tuple), required="a list of PairDataset")
        for part in parts:
            check_type("parts", part, PairDataset)
        check_whole("seed", seed)
        check_whole("batch", batch, 1)
        if not parts:
            raise CallError(
                "there is no dataset to draw from", where="parts", found="an empty list"
            )
        self.parts, self.seed, self.batch = list(parts), seed, batch
        self._ends = np.cumsum([len(part) for part in self.parts])

    def __len__(self) -> int:
        return int(self._ends[-1])

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        """Draw sample number `index` (any number >= 0)."""
        check_number(index)
        rng = sample_generator(self.seed, index // self.batch, MIXING_STREAM)
        part = int(np.searchsorted(self._ends, rng.integers(self._ends[-1]), side="right"))
        return self.parts[part][index]
