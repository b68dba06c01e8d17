"""A dataset of printed cards that turn and slide: every answer is known in closed form."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pliant.baselines import Frame
from pliant.cli.main import run
from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.io.exr import Surface, write_surface
from pliant.spec.io.png import write_rgb
from pliant.spec.storage import layout
from tests.dataset_files import coordinate, listing_row, tier, write_dataset, write_queries

WIDTH, HEIGHT = 240, 200
HALF_SIDE = 64.0  # of the card, in its own px

METHODS_FILE = '''
import numpy as np
import neighbour_of_the_file
from pliant.baselines import Answers


class Shift:
    """Every point moves by the same amount."""

    def __init__(self, du: float = 0.0, dv: float = 0.0):
        self.by = np.array([du, dv], np.float32)

    def answer(self, pair):
        return Answers(pair.uv_a_px + self.by)


class OnlyMatches:
    name = "three-matches"

    def match(self, source, target):
        at = np.array([[10, 10], [200, 20], [50, 150]], np.float32)
        return at, at + 4


def function(source, target, queries, by=1.0):
    return queries + by


def factory(amount):
    return Shift(amount, amount)


def two_images(first, second, preset=1):
    return first


ready = Shift(2, 2)
number = 7
'''


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

    def locate(self, uv_px: FloatArray) -> FloatArray:
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


def card_surface(pose: Similarity) -> tuple[npt.NDArray[np.uint8], Surface]:
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


@pytest.fixture(scope="session")
def pose() -> type[Similarity]:
    return Similarity


@pytest.fixture(scope="session")
def view_of() -> Callable[[Similarity], Frame]:
    return card_view


@pytest.fixture(scope="session")
def card_queries() -> FloatArray:
    """Sixty places well inside the card, in its own px."""
    return np.random.default_rng(3).uniform(-45, 45, (60, 2))


POSES = (
    Similarity(),
    Similarity(angle_deg=25, centre=(122.3, 97.6)),
    Similarity(angle_deg=-70, centre=(118.2, 104.9)),
)
PAIRS = ((0, 1), (0, 2), (2, 1))


def write_cards(root: Path) -> None:
    """Write the dataset: one sequence of three frames, three pairs of twenty queries."""
    sequence = "card-test-000000"
    folder = layout.sequence_dir(root, "card", sequence)
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    for frame, pose in enumerate(POSES):
        rgb, surface = card_surface(pose)
        write_rgb(folder / layout.rgb_name(frame), rgb)
        write_surface(folder / layout.depth_name(frame), surface)
    side = [coordinate(name, 0, 1, 0.128) for name in ("u", "v")]
    described = tier("card", "cloth", {"card": side}, variant="printed")
    row = listing_row(sequence, "card", "test", len(POSES))
    write_dataset(root, "cards", [row], [described], (WIDTH, HEIGHT))
    rng = np.random.default_rng(11)
    queries: list[dict[str, Any]] = []
    truth: list[dict[str, Any]] = []
    for pair, (a, b) in enumerate(PAIRS):
        for query, card in enumerate(rng.uniform(-45, 45, (20, 2))):
            key = {"pair_id": pair, "query_id": query, "tier": "card"}
            u_a, v_a = POSES[a].place(card)
            u_b, v_b = POSES[b].place(card)
            frames = {"sequence_a": sequence, "frame_a": a, "sequence_b": sequence, "frame_b": b}
            queries.append({**key, **frames, "u_a": u_a, "v_a": v_a})
            hidden = query == 19
            answer = {"u_b": u_b, "v_b": v_b, "visibility_b": "occluded" if hidden else "visible"}
            truth.append({**key, "point": query, **answer, "box_px": 128.0, "alternatives": []})
    write_queries(root, "cards", "test", queries, truth)


Called = Callable[..., tuple[int, str, str]]


@pytest.fixture
def called(capsys: pytest.CaptureFixture[str]) -> Called:
    """Call `pliant` in this process; return its exit code, its output and its messages."""

    def call(*arguments: object) -> tuple[int, str, str]:
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture(scope="session")
def cards_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset's folder; tests that damage it take `own_cards`."""
    root = tmp_path_factory.mktemp("cards") / "cards"
    root.mkdir()
    write_cards(root)
    return root


@pytest.fixture
def own_cards(cards_root: Path, tmp_path: Path) -> Path:
    """A copy of the dataset's folder."""
    return Path(shutil.copytree(cards_root, tmp_path / "cards"))


@pytest.fixture(scope="session")
def cards(cards_root: Path) -> Dataset:
    return Dataset.open(cards_root)
