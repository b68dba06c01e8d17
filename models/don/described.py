"""Views as the network sees them: resized, with masks, and their maps of descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from pliant.baselines.shared_cache import SharedCache
from pliant.loaders.inputs import NetworkInput
from pliant.models.don.ball import BallNetwork
from pliant.models.don.mask_repair import is_surely_unchanged, repaired
from pliant.models.don.one_rope import resized
from pliant.models.don.segmentation import cloth_mask, cloth_probability, denoised, rope_masks
from pliant.models.don.table import on_plain_table
from pliant.models.networks.descriptor_network import DescriptorNetwork, NetworkOutput
from pliant.models.networks.mask_network import CLOTH_SIDE, MaskNetwork
from pliant.models.networks.print_network import PrintNetwork, is_printed
from pliant.spec.arrays import Float32Array, FloatArray, Mask, Rgb
from pliant.spec.frame import Frame
from pliant.spec.io.resizing import resize_mask, resize_nearest, resize_rgb
from pliant.spec.lru_cache import LRUCache

_KEPT_BYTES = 256 * 2**20
_LEAST_KEPT = 8
_KEPT_MASKS = 256
_CONFIDENCE_EVERY = 4  # the mean over every fourth pixel differs by 0.0014 (standard deviation)
_KEPT_UPRIGHT = 10  # both views of a pair, each as it is and as from above or in four turns


@dataclass(frozen=True)
class DescribedView:
    """A frame's descriptors.

    Attributes:
        maps: One a quarter turn: float (D, h, w) or, turned an odd number of times, (D, w, h).
        mirrored: float (D, h, w), of the mirrored frame, each at the pixel of the frame itself that
            it describes; None where mirrored copies do not vote.
        mask: bool (h, w), the queried object, or None.
        objects: bool (h, w), any object, or None.
        printed: Whether the object is seen to have several colours.
        prints: float (D', h, w), descriptors of the print; None where there is none, or nothing
            that describes it.
    """

    maps: list[torch.Tensor]
    mirrored: torch.Tensor | None
    mask: Mask | None
    objects: Mask | None
    printed: bool = False
    prints: torch.Tensor | None = None

    def on_object(self) -> Float32Array:
        """Return the descriptors on the object (everywhere without a mask), float32 (n, D)."""
        upright = self.maps[0]
        flat: Float32Array = upright.flatten(1).T.numpy()
        return flat if self.mask is None or not self.mask.any() else flat[self.mask.reshape(-1)]


@dataclass(frozen=True)
class _UprightView:
    """A frame as the network sees it, not turned.

    Attributes:
        image: float (C, h, w), the network's input.
        mask: bool (h, w), the queried object, or None.
        objects: bool (h, w), any object, or None.
        descriptors: float (D, h, w).
        rgb: uint8 (h, w, 3), the picture with its own table, or None for a network of depth.
    """

    image: torch.Tensor
    mask: Mask | None
    objects: Mask | None
    descriptors: torch.Tensor
    rgb: Rgb | None


def _bytes_of(described: DescribedView) -> int:
    """Return how many bytes the maps take."""
    others = (described.mirrored, described.prints)
    maps = [*described.maps, *(each for each in others if each is not None)]
    return sum(each.nbytes for each in maps)


class ViewDescriber:
    """Describes views with a network, and remembers the last ones by their keys.

    Args:
        network: The network.
        given: What it is given of an image.
        size: (w, h) of its input.
        rotations: 1, 2 or 4 quarter-turned copies.
        mirrored: Describe mirrored copies too.
        plain_table: Show the network objects on a table without pattern.

    Attributes:
        masks: Finds objects in pictures, or None: the descriptor network's foreground does.
        ball: Finds the ball of a rope in pictures, or None: what is thick and round is one.
        prints: Describes the print of a cloth, or None.
    """

    def __init__(
        self,
        network: DescriptorNetwork,
        given: NetworkInput,
        size: tuple[int, int],
        rotations: int,
        *,
        mirrored: bool,
        plain_table: bool,
    ) -> None:
        self.network, self.given, self.size, self.mirrored = network, given, size, mirrored
        self.plain_table = plain_table
        self.masks: MaskNetwork | None = None
        self.ball: BallNetwork | None = None
        self.prints: PrintNetwork | None = None
        self.turns = range(0, 4, 4 // rotations)
        self._kept: LRUCache[DescribedView] = LRUCache(_KEPT_BYTES, _bytes_of, least=_LEAST_KEPT)
        self._upright: LRUCache[_UprightView] = LRUCache(_KEPT_UPRIGHT)
        self._found: LRUCache[tuple[Mask, Mask | None] | None] = LRUCache(_KEPT_MASKS)

    def share(self, folder: Path) -> None:
        """Store found masks in a folder, where copies in other processes find them."""
        self._found = SharedCache(_KEPT_MASKS, folder)

    def described(self, view: Frame) -> DescribedView:
        """Return a view's descriptors; without a mask, with the one that the network predicts."""
        return self._kept.get(view.cache_key, lambda: self._describe(view))

    def pixel_scale(self, view: Frame) -> FloatArray:
        """Return pixels of a view per network pixel, (u, v)."""
        return np.array([view.rgb.shape[1] / self.size[0], view.rgb.shape[0] / self.size[1]])

    @property
    def segments(self) -> bool:
        """Whether `segmented` finds anything: the network predicts masks and sees a picture."""
        return self.network.foreground and self.given.colour

    def segmented(self, view: Frame) -> Frame:
        """Return a view of a rope with masks found in its picture, where it has none.

        Masks that do not follow the picture's contours are corrected. The view stays as it is for a
        network that predicts no masks or sees no picture, and where nothing stands out from the
        table.
        """
        if not self.segments or (view.mask is not None and not view.mask.any()):
            return view
        found = self._found.get(view.cache_key, lambda: self._find(view))
        if found is None:
            return view
        return view.replace(variant="segmented", mask=found[0], objects=found[1])

    def foreground(self, view: Frame) -> Frame:
        """Return a view of a cloth with a mask found in its picture, where it has none.

        It is sharpened by colour. The view stays as it is for a network that predicts no masks or
        sees no picture, and where nothing stands out from the table.
        """
        if view.mask is not None or not self.segments:
            return view
        found = self._found.get(view.cache_key, lambda: self._find_cloth(view))
        return view if found is None else view.replace(variant="foreground", mask=found[0])

    def _find_cloth(self, view: Frame) -> tuple[Mask, None] | None:
        """Return the mask of `foreground`, or None where nothing stands out."""
        rgb = denoised(view.rgb)
        if self.masks is None:
            cloth = self._foreground(view)[0]
        else:
            found = self.masks.found(rgb, CLOTH_SIDE)[0]
            cloth = cloth_probability(found, lambda: self._foreground(view)[0])
        mask = cloth_mask(rgb, cloth)
        return None if mask is None else (mask, None)

    def _find(self, view: Frame) -> tuple[Mask, Mask | None] | None:
        """Return the masks of `segmented`, or None for those that the view has."""
        rgb = denoised(view.rgb)
        if self.masks is None:
            rope, objects = self._foreground(view)
        else:
            rope, objects = self.masks.found(rgb)
            mask, given = view.mask, view.objects
            if mask is not None and given is not None:
                seen = resized(np.maximum(rope, objects) > 0.5, mask.shape)
                if is_surely_unchanged(mask, given, seen):
                    return None
        found = rope_masks(rgb, rope, objects, self.ball)
        if found is not None and view.mask is not None:
            found = repaired(view.mask, view.objects, found)
        return found

    def confidence(self, view: Frame) -> float:
        """Return the mean log probability of the likeliest material coordinates on the object.

        It is 0 for a network without a canonical head.
        """
        head = self.network.canonical
        if head is None:
            return 0.0
        upright = self._seen(view)
        described = DescribedView([upright.descriptors], None, upright.mask, None)
        rows = torch.from_numpy(described.on_object()[::_CONFIDENCE_EVERY])
        parts = head.log_probabilities_in_parts(rows, self.network.scale.detach().cpu())
        return float(torch.cat([part.max(dim=1).values for part in parts]).mean())

    def _describe(self, view: Frame) -> DescribedView:
        upright = self._seen(view)
        maps = [upright.descriptors]
        maps += [self._descriptors(upright.image, turn) for turn in self.turns[1:]]
        mirrored = self._descriptors(upright.image.flip(2), 0).flip(2) if self.mirrored else None
        rgb, mask, printed, prints = upright.rgb, upright.mask, False, None
        if rgb is not None and mask is not None:
            printed = is_printed(rgb, mask)
            if printed and self.prints is not None:
                prints = self.prints.described(rgb, mask)
        return DescribedView(maps, mirrored, mask, upright.objects, printed, prints)

    def _seen(self, view: Frame) -> _UprightView:
        """Return a view as the network sees it, which it may be asked for twice."""
        return self._upright.get(view.cache_key, lambda: self._see(view))

    def _see(self, view: Frame) -> _UprightView:
        rgb, depth_m = self._resized(view)
        mask, objects = (
            None if each is None else resize_mask(each, self.size, keep_thin=True)
            for each in (view.mask, view.objects)
        )
        if mask is None and self.given.masks and self.network.foreground:
            logits = self._out(self.given.image(rgb, depth_m)).foreground[0].cpu()
            mask, objects = (logits > 0).numpy()
        shown = rgb
        if self.plain_table and rgb is not None and mask is not None:
            shown = on_plain_table(rgb, mask if objects is None else mask | objects)
        image = torch.from_numpy(self.given.image(shown, depth_m, mask, objects))
        return _UprightView(image, mask, objects, self._descriptors(image, 0), rgb)

    def _descriptors(self, image: torch.Tensor, turn: int) -> torch.Tensor:
        """Return the descriptors of an image turned by quarter turns."""
        with torch.inference_mode():
            return self.network(self._turned(image, turn))[0].cpu()

    def _resized(self, view: Frame) -> tuple[Rgb | None, Float32Array | None]:
        rgb = resize_rgb(view.rgb, self.size) if self.given.colour else None
        depth_m = None
        if not self.given.colour and view.depth_m is not None:
            depth_m = resize_nearest(view.depth_m, self.size)
        return rgb, depth_m

    def _foreground(self, view: Frame) -> Float32Array:
        """Return the network's probabilities of the object and of any object, (2, h, w)."""
        out = self._out(self.given.image(*self._resized(view)))
        return np.asarray(out.foreground[0].cpu().sigmoid().numpy())

    def _out(self, image: Float32Array) -> NetworkOutput:
        """Return all that the network puts out for an image without masks."""
        with torch.inference_mode():
            return self.network.described(self._turned(torch.from_numpy(image), 0))

    def _turned(self, image: torch.Tensor, turn: int) -> torch.Tensor:
        return torch.rot90(image, -turn, (1, 2))[None].to(self.network.log_scale.device)
