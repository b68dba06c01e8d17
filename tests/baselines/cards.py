"""Printed cards that turn and slide: where each of their places is, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.baselines import Frame
from pliant.spec.arrays import Float32Array, FloatArray, ImageArray
from pliant.spec.frame import Pair
from pliant.spec.io.exr import Surface

WIDTH, HEIGHT = 240, 200
HALF_SIDE = 64.0  # of the card, in its own px

CARD_QUERIES = np.random.default_rng(3).uniform(-45, 45, (60, 2))
"""Sixty places well inside the card, in its own px."""


@dataclass(frozen=True)
class Similarity:
    """Where a card lies: uv = centre + scale · rotation · card coordinates."""

    angle_deg: float = 0.0
    scale: float = 1.0
    centre: tuple[float, float] = (WIDTH / 2, HEIGHT / 2)

    @property
    def matrix(self) -> FloatArray:
        angle = np.radians(self.angle_deg)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return self.scale * turn

    def place(self, card: FloatArray) -> FloatArray:
        return card @ self.matrix.T + self.centre

    def locate(self, uv_px: npt.NDArray[Any]) -> FloatArray:
        return (uv_px - self.centre) @ np.linalg.inv(self.matrix).T


def print_of(card: FloatArray) -> FloatArray:
    """Brightness of the card's print: plane waves of 5 to 40 px, evaluated exactly."""
    rng = np.random.default_rng(7)
    total = np.zeros(card.shape[:-1])
    for _ in range(40):
        period, direction, phase = rng.uniform(5, 40), rng.uniform(0, np.pi), rng.uniform(0, 6.28)
        along = card[..., 0] * np.cos(direction) + card[..., 1] * np.sin(direction)
        total += np.cos(2 * np.pi * along / period + phase)
    return 128 + 18 * total


def card_surface(pose: Similarity) -> tuple[ImageArray, Surface]:
    """Render a card by evaluating its print at every pixel's centre."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    card = pose.locate(np.stack([u, v], axis=-1))
    on = (np.abs(card) < HALF_SIDE).all(axis=-1)
    grey = np.where(on, print_of(card), 90)
    rgb = np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    material = np.where(on[..., None], card / HALF_SIDE / 2 + 0.5, 0).astype(np.float32)
    surface = Surface(
        depth_m=np.where(on, 1.0, np.inf).astype(np.float32),
        m0=np.ascontiguousarray(material[..., 0]),
        m1=np.ascontiguousarray(material[..., 1]),
        object_id=on.astype(np.uint32),
    )
    return rgb, surface


def card_view(pose: Similarity, key: str = "") -> Frame:
    rgb, surface = card_surface(pose)
    return Frame(rgb=rgb, mask=surface.object_id == 1, depth_m=surface.depth_m, key=key)


@dataclass(frozen=True)
class Motion:
    """A card before and after an exact motion, with queries on it."""

    before: Similarity
    after: Similarity

    @cached_property
    def source(self) -> Frame:
        return card_view(self.before, "before")

    @cached_property
    def target(self) -> Frame:
        return card_view(self.after, "after")

    @property
    def queries(self) -> Float32Array:
        return self.before.place(CARD_QUERIES).astype(np.float32)

    @property
    def pair(self) -> Pair:
        return Pair(self.source, self.target, self.queries)

    def move(self, uv_px: npt.NDArray[Any]) -> FloatArray:
        return self.after.place(self.before.locate(uv_px))

    def error(self, found: Float32Array) -> FloatArray:
        return np.asarray(np.linalg.norm(found - self.after.place(CARD_QUERIES), axis=1))
