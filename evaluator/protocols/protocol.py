"""Protocols: frozen, named JSON files that say which metrics are counted and how."""

from __future__ import annotations

import functools
import hashlib
import importlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import model_validator

from pliant.evaluator.metrics.base import Metric
from pliant.evaluator.metrics.slices import Slices
from pliant.evaluator.statistics.bootstrap import Bootstrap
from pliant.evaluator.statistics.ratios import Figure, Ratio
from pliant.evaluator.submission.queries import Queries
from pliant.spec.configuration import Settings, read_mapping, settings_from, settings_to_dict
from pliant.spec.constraints import NotEmpty, Refused
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.jsonfiles import parse_json
from pliant.spec.io.reading import FileRefusedError

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

    @model_validator(mode="after")
    def _check(self) -> Protocol:
        if self.kind == "matches" and "matches" not in self.metrics:
            raise Refused("the family matches, which places keypoint matches", "metrics")
        return self

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

    @functools.cached_property
    def headings(self) -> dict[str, Figure]:
        """The metrics by name, and those that only slices have."""
        slices = self.settings.get("slices")
        of_slices = [] if slices is None else Slices.of_slice(slices)
        return self.figures | {x.name: x for x in of_slices if x.name not in self.figures}

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


def protocol_text(name: str | Path, path: Path | None = None, where: str | None = None) -> bytes:
    """Return the text of a protocol, as JSON.

    Args:
        name: One of `PROTOCOL_NAMES`, or the path of a protocol's JSON or YAML file.
        path: The rules that name it; a relative path starts at their folder. None: it starts at
            the current one.
        where: The place in them.

    Raises:
        CallError: A protocol is neither built in nor a file.
    """
    if name in PROTOCOL_NAMES:
        return (_FOLDER / f"{name}.json").read_bytes()
    file = Path(name) if path is None else path.parent / name
    if not file.is_file():
        required = f"{', '.join(PROTOCOL_NAMES)}, or a file"
        found = repr(str(name))[:100]
        raise CallError("no such protocol", path=path, where=where, found=found, required=required)
    if file.suffix in (".yaml", ".yml"):
        return json.dumps(read_mapping(file)).encode()
    return file.read_bytes()


def parse_protocol(text: bytes, path: Path | None = None) -> Protocol:
    """Return the protocol of a JSON text.

    Args:
        text: From `protocol_text`.
        path: The file it comes from, for messages.

    Raises:
        CallError: A setting is missing, unknown or invalid.
    """
    try:
        values = parse_json(text, path or "protocol")
    except FileRefusedError as error:
        raise CallError(error.message, path=path, found=error.found, fix=error.fix) from error
    if isinstance(values, dict):
        values["sha256"] = hashlib.sha256(text).hexdigest()
    protocol = settings_from(Protocol, values, path=path)
    figures = protocol.figures  # checks the families too
    if unknown := [name for name in protocol.headline if name not in figures]:
        raise CallError(
            "the headline names a metric that the protocol does not compute",
            path=path,
            where="headline",
            found=", ".join(unknown),
            required=", ".join(figures),
        )
    return protocol


@functools.cache
def read_protocol(name: str) -> Protocol:
    """Return a built-in protocol by its name.

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
    return parse_protocol(protocol_text(name))


def find_protocol(given: str | Path | Protocol) -> Protocol:
    """Return a protocol that a call names: a built-in one, that of a file, or itself.

    Args:
        given: A protocol, or an argument of `protocol_text`.

    Raises:
        CallError: As `protocol_text` and `parse_protocol`.
    """
    if isinstance(given, Protocol):
        return given
    if given in PROTOCOL_NAMES:
        return read_protocol(str(given))
    return parse_protocol(protocol_text(given), Path(given))


def recorded(protocol: Protocol) -> dict[str, Any]:
    """Return what scores.json says of a protocol that is not built in; nothing of another.

    Pages and comparisons need neither its file nor the modules of its metrics: what they show and
    how they average is in the scores.
    """
    name = protocol.name
    if name in PROTOCOL_NAMES and read_protocol(name).sha256 == protocol.sha256:
        return {}
    figures = [asdict(each) for each in protocol.headings.values()]
    return {"own_protocol": {"document": protocol.document, "figures": figures}}


def figures_of(document: Mapping[str, Any]) -> dict[str, Figure]:
    """Return the figures of scores.json by name; imports nothing that the document names.

    Args:
        document: The content of scores.json.
    """
    if "own_protocol" not in document:
        return read_protocol(document["protocol"]).headings
    rows = document["own_protocol"]["figures"]
    figures = [Ratio(**row) if "numerator" in row else Figure(**row) for row in rows]
    return {figure.name: figure for figure in figures}


def ratios_of(document: Mapping[str, Any]) -> dict[str, Ratio]:
    """Return the averaged metrics of scores.json by name, as `figures_of`."""
    scored, figures = document["overall"], figures_of(document).values()
    return {each.name: each for each in figures if isinstance(each, Ratio) and each.name in scored}


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
        found: Any = getattr(importlib.import_module(module), name)
    except (ModuleNotFoundError, AttributeError, TypeError, ValueError):  # such as `.a:B` and `:B`
        found = None
    if not isinstance(found, type) or not issubclass(found, Metric):
        required = f"class {name} in {module}, a Metric"
        raise CallError("no such family of metrics", found=repr(family), required=required)
    return found
