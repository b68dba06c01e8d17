"""Protocols: frozen, named JSON files that say which metrics are counted and how."""

from __future__ import annotations

import functools
import hashlib
import importlib
import json
from importlib import resources
from typing import Annotated, Any, Final, Literal

from pliant.evaluator.metrics.base import Metric
from pliant.evaluator.statistics.bootstrap import Bootstrap
from pliant.evaluator.statistics.ratios import Figure, Ratio
from pliant.evaluator.submission.queries import Queries
from pliant.spec.configuration import Settings, settings_from, settings_to_dict
from pliant.spec.constraints import NotEmpty
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError

_FOLDER: Final = resources.files("pliant.evaluator") / "protocols"
PROTOCOL_NAMES: Final = tuple(
    sorted(each.name[:-5] for each in _FOLDER.iterdir() if each.name.endswith(".json"))
)


class Policy(Settings):
    """What happens to answers that are missing, doubled, unknown or unusual."""

    missing: Literal["error", "counted_in_coverage"]
    missing_if_allowed: Literal["worst_value", "counted_in_coverage"]
    duplicate: Literal["error", "best_score_per_source_pixel"]
    unknown: Literal["error"]
    not_finite: Literal["error"]
    outside_image: Literal["scored_by_distance"]
    position_bound_px: Literal[1000000]
    predictions: Literal["as_submitted"]


class Protocol(Settings):
    """One protocol, as its file says.

    Attributes:
        name: Its name.
        version: `MAJOR.MINOR` of the protocol itself.
        kind: Kind of submission it scores.
        summary: What it is for, in one sentence.
        counted: Which queries or matches count.
        policy: What happens to unusual answers.
        definitions: What each figure is, in words: what is averaged over what.
        headline: The metrics to show first.
        metrics: Family of metrics -> its settings; families not named are not computed.
        bootstrap: The confidence intervals.
        sha256: Of the protocol's file; two scores compare only where it is the same.
    """

    name: str
    version: str
    kind: Literal["answers", "matches"]
    summary: str
    counted: Literal["visible_in_b", "source_on_object_and_visible_in_b"]
    policy: Policy
    definitions: Annotated[dict[str, str], NotEmpty()]
    headline: Annotated[tuple[str, ...], NotEmpty()]
    metrics: dict[str, dict[str, Any]]
    bootstrap: Bootstrap
    sha256: str

    @functools.cached_property
    def settings(self) -> dict[str, Any]:
        """Family of metrics -> its settings as the family's own class."""
        return {
            family: settings_from(metric_class(family).Settings, values, f"metrics.{family}")
            for family, values in self.metrics.items()
        }

    @functools.cached_property
    def figures(self) -> dict[str, Figure]:
        """The metrics by name, in the order of a report."""
        found = [
            figure
            for family, settings in self.settings.items()
            for figure in metric_class(family).figures(settings)
        ]
        return {figure.name: figure for figure in found}

    @property
    def ratios(self) -> dict[str, Ratio]:
        """The averaged metrics by name."""
        return {name: each for name, each in self.figures.items() if isinstance(each, Ratio)}

    def check_episodes(
        self, dataset: Dataset, split: str, queries: Queries, *, allow_empty: bool
    ) -> None:
        """Refuse a split without episodes if the headline needs them.

        Args:
            dataset: The dataset.
            split: The split.
            queries: Its queries.
            allow_empty: Accept headline figures without a value, if at least one has a value.

        Raises:
            CallError: The split has no episodes, and headline figures would have no value.
        """
        of_episodes = {
            figure.name
            for family, settings in self.settings.items()
            for figure in metric_class(family).figures(settings)
            if metric_class(family).episodes
        }
        empty = [name in of_episodes for name in self.headline]
        needed = all(empty) if allow_empty else any(empty)
        if needed and not queries.in_episode(dataset).any():
            raise CallError(
                f"protocol {self.name} scores points followed through episodes",
                path=dataset.address,
                found=f"no image pair of split {split} has two frames of one episode",
                fix="Name another protocol.",
            )

    @property
    def document(self) -> dict[str, Any]:
        """The protocol as its file has it."""
        values: dict[str, Any] = settings_to_dict(self)
        del values["sha256"]
        return values


def parse_protocol(text: bytes) -> Protocol:
    """Return the protocol of a JSON text.

    Raises:
        CallError: A setting is missing, unknown or invalid.
    """
    values = {**json.loads(text), "sha256": hashlib.sha256(text).hexdigest()}
    protocol = settings_from(Protocol, values)
    _ = protocol.settings  # checks the families too
    return protocol


@functools.cache
def read_protocol(name: str) -> Protocol:
    """Return a protocol by its name.

    Args:
        name: One of `PROTOCOL_NAMES`.

    Raises:
        CallError: The protocol is unknown.

    Examples:
        >>> pliant.evaluator.read_protocol("paper").kind
        'answers'
    """
    if name not in PROTOCOL_NAMES:
        raise CallError("no such protocol", found=repr(name), required=", ".join(PROTOCOL_NAMES))
    return parse_protocol((_FOLDER / f"{name}.json").read_bytes())


@functools.cache
def metric_class(family: str) -> type[Metric[Any]]:
    """Return the class of a family of metrics.

    Args:
        family: Name of a module in `evaluator/metrics/`, whose class has the same name in title
            case; or `module:Class` for a class elsewhere.

    Raises:
        CallError: The class is unknown.
    """
    module, _, name = family.partition(":")
    if not name:
        module, name = f"pliant.evaluator.metrics.{family}", family.title()
    try:
        found: type[Metric[Any]] = getattr(importlib.import_module(module), name)
    except (ModuleNotFoundError, AttributeError) as error:
        raise CallError(
            "no such family of metrics", found=repr(family), required=f"class {name} in {module}"
        ) from error
    return found
