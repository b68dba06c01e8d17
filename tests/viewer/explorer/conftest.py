"""An explorer of the tiny dataset, with a method whose answers and heat maps are known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from pliant.baselines.controls import Identity
from pliant.baselines.matcher import Heat
from pliant.spec.answers import Answers
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame, Pair

pytest.importorskip("starlette", reason="the explorer needs the extra 'explore'")
pytest.importorskip("uvicorn", reason="the explorer needs the extra 'explore'")

from pliant.viewer.explorer.app import Explorer
from pliant.viewer.explorer.frames import FrameCache
from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.recorded import RecordedQueries
from pliant.viewer.explorer.submissions import read_submission
from tests.viewer.serving import served

SHIFT_PX = 6.0


class Shifted(Identity):
    """Answers the query's own pixel, a little to the right; its heat is a hill there."""

    name = "shifted"

    def answer(self, pair: Pair) -> Answers:
        sigma = np.full(len(pair.uv_a_px), 2.0, np.float32)
        return Answers(pair.uv_a_px + np.array([SHIFT_PX, 0], np.float32), sigma_px=sigma)

    def heat(self, source: Frame, target: Frame, uv_a_px: npt.NDArray[np.float32]) -> Heat:
        height, width = target.rgb.shape[:2]
        v, u = np.mgrid[:height, :width] + 0.5
        squared = (u - uv_a_px[0] - SHIFT_PX) ** 2 + (v - uv_a_px[1]) ** 2
        hill = (-squared / 8).astype(np.float32)
        return Heat(hill, "log probability", 0.75, "probability of the peak")


@pytest.fixture(scope="session")
def explorer(tiny_dataset: Path, submit: Callable[[Path, float], Path]) -> Explorer:
    """An explorer with a live method and a recorded one that is 5 px off."""
    return make_explorer(tiny_dataset, submit(tiny_dataset, 5.0))


def make_explorer(root: Path, submission: Path) -> Explorer:
    """Return an explorer of a dataset with `Shifted` and the answers of a submission."""
    dataset = Dataset.open(root)
    frames, queries = FrameCache(dataset), RecordedQueries(dataset)
    recorded = read_submission(submission, dataset, queries)
    return Explorer(frames, queries, [LiveMethod(Shifted()), recorded])


@pytest.fixture(scope="session")
def address(explorer: Explorer) -> Iterator[str]:
    """The address of the explorer's page."""
    with served(explorer.application) as address:
        yield address
