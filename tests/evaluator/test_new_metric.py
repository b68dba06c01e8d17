"""A metric is one class: what CONTRIBUTING.md, "Add a metric", asks for, in one example."""

from __future__ import annotations

import json
from typing import Annotated, Any

import numpy as np
import pytest

from pliant.evaluator import evaluate_answers, read_protocol
from pliant.evaluator.metrics.base import Metric
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.protocols.protocol import parse_protocol
from pliant.evaluator.statistics.ratios import Figure, Ratio
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds
from pliant.spec.errors import CallError


class HuberSettings(Settings):
    """Settings of `huber`."""

    delta_px: Annotated[float, Bounds(0, above=True)]


class Huber(Metric[HuberSettings]):
    """The Huber loss of the error (Huber 1964): quadratic up to delta, linear beyond."""

    Settings = HuberSettings

    @classmethod
    def figures(cls, settings: HuberSettings) -> list[Figure]:
        """Return the mean loss."""
        about = f"mean Huber loss, delta {settings.delta_px:g} px"
        return [Ratio("huber_px2", "lower", "px2", about, "Huber", "sum_huber_px2", "counted")]

    def update(self, block: Block) -> None:
        """Take in one block."""
        delta, error = self.settings.delta_px, block.error_px
        loss = np.where(error <= delta, error**2 / 2, delta * (error - delta / 2))
        self.add_sums(block, sum_huber_px2=np.where(block.counted, loss, 0.0))


def protocol_with(settings: dict[str, Any]) -> bytes:
    metrics = {f"{__name__}:Huber": settings}
    changes = {"name": "robust", "headline": ["huber_px2"], "metrics": metrics}
    return json.dumps(read_protocol("paper").document | changes).encode()


def test_an_example_metric_is_scored_with_intervals_and_a_label(scene: Any) -> None:
    protocol = parse_protocol(protocol_with({"delta_px": 4}))
    off = scene.true_px + np.where(scene.pair[:, None] % 2, [3.0, 0.0], [0.0, 10.0])
    scores = evaluate_answers(scene.root, scene.split, off, protocol=protocol)
    losses = np.where(scene.pair % 2, 3**2 / 2, 4 * (10 - 2))[scene.visible]
    assert scores.overall["huber_px2"] == pytest.approx(losses.mean(), rel=1e-6)
    assert set(scores.tiers) == {"cloth", "rope"}
    low, high = scores.document["intervals"]["overall"]["huber_px2"]
    assert low < losses.mean() < high
    assert protocol.figures["huber_px2"].title == "Huber"


def test_a_wrong_setting_of_a_metric_names_the_family_and_the_setting() -> None:
    with pytest.raises(CallError, match=r"metrics\..*Huber.delta_px.*required: > 0"):
        parse_protocol(protocol_with({"delta_px": 0}))
