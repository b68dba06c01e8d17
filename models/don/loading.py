"""Networks and matchers of runs: from a config, and from a run's folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

from torch import nn

from pliant.models.don.ball import BallNetwork
from pliant.models.don.certainty import Calibration
from pliant.models.don.crossings import CROSSINGS, CrossingNetwork
from pliant.models.don.familiarity import FAMILIARITY, Familiarity
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.settings import DonSettings
from pliant.models.networks.canonical import PREFIX, CanonicalHead
from pliant.models.networks.descriptor_network import DescriptorNetwork
from pliant.models.networks.mask_network import MASKS, MaskNetwork
from pliant.models.networks.print_network import PRINTS, PrintNetwork
from pliant.models.training.checkpoint import (
    best_weights,
    load_weights,
    put_weights,
    read_weights_file,
)
from pliant.models.training.run_folder import BALL, CALIBRATION, CONFIG, RUN_FACTS, read_run_json
from pliant.spec.configuration import read_settings
from pliant.spec.errors import CallError, TrainingError

N = TypeVar("N", bound=nn.Module)


def don_network(settings: DonSettings, canonical: CanonicalHead | None) -> DescriptorNetwork:
    """Return the network of a run with its starting weights.

    Args:
        settings: The run's settings.
        canonical: Its canonical head, or None.

    Raises:
        CallError: The pretrained weights cannot be found or do not fit.
    """
    loss = settings.loss
    return DescriptorNetwork(
        settings.network,
        settings.pairs.network_input,
        initial_scale=loss.initial_scale,
        learn_scale=loss.learn_scale,
        orientation=loss.orientation_weight > 0,
        foreground=loss.foreground_weight > 0,
        canonical=canonical,
    )


def load_matcher(run: Path | str, /, **options: Any) -> DonMatcher:
    """Return the matcher of a finished (or running) training run.

    Args:
        run: The run's folder.
        options: Fields of `AnswerSettings`, instead of those of the run's config.

    Raises:
        CallError: It is not a run's folder, or has no such option.
        TrainingError: The run has no validated weights yet, or a file of it is damaged.
    """
    run = Path(run)
    if not (run / CONFIG).is_file():
        raise CallError("this is not a training run", path=run, required=f"a folder with {CONFIG}")
    settings = read_settings(DonSettings, run / CONFIG)
    settings = settings.replace(
        network=settings.network.replace(pretrained=""), answer=settings.answer.replace(**options)
    )
    best = best_weights(run)
    weights, canonical = read_weights_file(best), None
    if settings.loss.canonical_weight > 0:
        anchors = weights.get(PREFIX + "anchors", ())
        canonical = CanonicalHead(settings.network.descriptor_dim, len(anchors))
    network = don_network(settings, canonical)
    put_weights(network, weights, best)
    facts, calibration = read_run_json(run / RUN_FACTS), None
    if values := read_run_json(run / CALIBRATION):
        try:
            calibration = Calibration.from_document(values)
        except TypeError as error:
            raise TrainingError(
                "the calibration is damaged", path=run / CALIBRATION, found=str(error)
            ) from error
    elif facts:
        raise TrainingError(
            "the calibration of a finished run is missing",
            path=run / CALIBRATION,
            fix="Copy it from the run's folder, or make it there with --resume.",
        )
    matcher = DonMatcher(network, settings, calibration, facts)
    if (path := run / FAMILIARITY).is_file():
        familiarity = Familiarity.from_document(read_run_json(path), path)
        if familiarity.descriptors is not None or settings.answer.decode == "trace":
            matcher.familiarity = familiarity  # that of traces says nothing of other answers
    reader = matcher.reader
    if settings.answer.crossings:
        reader.crossings = _network_in(run / CROSSINGS, CrossingNetwork)
    matcher.match_prints_with(_network_in(run / PRINTS, PrintNetwork))
    if (run / MASKS).is_file():
        reader.find_masks_with(load_masks(run / MASKS), _network_in(run / BALL, BallNetwork))
    return matcher


def load_masks(path: Path) -> MaskNetwork:
    """Return the network for masks that a file has the weights of.

    Raises:
        TrainingError: The file is missing, damaged or of another network.
    """
    weights = read_weights_file(path)
    network = MaskNetwork.like(weights)
    put_weights(network, weights, path)
    return network


def _network_in(path: Path, kind: type[N]) -> N | None:
    """Return a small network with the weights of a file, or None where a run has no such file."""
    if not path.is_file():
        return None
    network = kind()
    load_weights(network, path)
    return network
