"""A dataset of printed cards that turn and slide: every answer is known in closed form."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.spec.dataset import Dataset
from pliant.spec.io.exr import write_surface
from pliant.spec.io.png import write_rgb
from pliant.spec.storage import layout
from tests.baselines.cards import HEIGHT, WIDTH, Similarity, card_surface
from tests.dataset_files import coordinate, listing_row, tier, write_dataset, write_queries

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


POSES = (
    Similarity(),
    Similarity(angle_deg=25, centre=(122.3, 97.6)),
    Similarity(angle_deg=-70, centre=(118.2, 104.9)),
)
PAIRS = ((0, 1), (0, 2), (2, 1))


def write_cards(root: Path) -> None:
    """Write the dataset: one sequence of three frames, three pairs of twenty queries."""
    sequence = "card-test-000000"
    folder = root / layout.sequence_name("card", sequence)
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
