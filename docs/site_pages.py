"""The site's generated pages, and the links of pages to files of the repository (mkdocs hook)."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pydantic_core import PydanticUndefined

from pliant.benchmarks.suite.config import BenchmarkConfig
from pliant.evaluator.protocols.protocol import PROTOCOL_NAMES, read_protocol
from pliant.evaluator.statistics.ratios import Figure
from pliant.generator.config import GenerateConfig
from pliant.models.don.settings import DonSettings
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.spec.configuration import Settings, settings_to_dict
from pliant.spec.constraints import Bounds, OneOf, unit_of

ROOT: Final = Path(__file__).resolve().parents[1]

COPIED: Final = {
    "spec/SPEC.md": "reference/format.md",
    **{
        f"spec/annexes/{name}.md": f"reference/format-{name}.md"
        for name in ("fields", "splits", "validation", "packing", "publication")
    },
    "spec/CHANGES.md": "reference/format-changes.md",
    "spec/conformance/README.md": "reference/conformance.md",
    "CHANGELOG.md": "reference/changelog.md",
}
"""File of the repository -> page of the site."""

SETTINGS: Final = {
    "pliant generate": GenerateConfig,
    "pliant train don": DonSettings,
    "pliant train timecycle": TimeCycleSettings,
    "pliant benchmark": BenchmarkConfig,
}

_WORDS: Final = {
    bool: "boolean",
    int: "integer",
    float: "number",
    str: "text",
    tuple: "list",
    Path: "path",
    NoneType: "none",
}

API: Final = {
    "Load, predict, evaluate": (
        *("api.load", "api.predict", "api.evaluate", "api.validate", "api.open_method"),
        *("api.stream", "streaming.PairStream"),
    ),
    "Datasets": (
        *("spec.dataset.Dataset", "spec.sequence.RecordedFrame"),
        *("spec.frame.Frame", "spec.frame.Pair"),
    ),
    "Methods": (
        *("baselines.matcher.Matcher", "baselines.matcher.KeypointMatcher"),
        *("baselines.matcher.HeatMatcher", "baselines.matcher.RemarkingMatcher"),
        *("baselines.matcher.TrackMatcher", "baselines.matcher.SplitMatcher"),
        *("baselines.views.read_frame", "models.load_matcher"),
        *("baselines.answers.checked_answers", "baselines.answers.checked_matches"),
        "baselines.answers.joined",
    ),
    "Scenes": (
        *("scene.bodies.Rope", "scene.bodies.Cloth", "scene.film.camera"),
        *("scene.film.Film", "scene.film.Shot", "scene.film.write"),
    ),
    "Scores": (
        *("evaluator.submission.loading.check", "evaluator.submission.loading.inspect"),
        *("evaluator.evaluate.evaluate", "evaluator.evaluate.evaluate_answers"),
        *("evaluator.protocols.protocol.read_protocol", "evaluator.scores.read_scores"),
        *("evaluator.scores.Scores", "evaluator.write_report"),
    ),
    "Training data": (
        *(
            "loaders.frame_store.FrameStore",
            "loaders.order.StepOrder",
            "loaders.pairs.PairSettings",
        ),
        *("loaders.pairs.PairDataset", "loaders.pairs.MixedPairs", "loaders.clips.ClipDataset"),
    ),
}
"""Title -> names below `pliant`, each with an example that a test runs."""

_LINK = re.compile(r"(!?)\[([^\[\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")
_CODE = re.compile(r"(^```.*?^```|`[^`\n]*`)", re.DOTALL | re.MULTILINE)
_MATHS = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+(?:\n[^$\n]+)?)\$", re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are copied from the repository or generated from the code."""
    pages = {target: (ROOT / source).read_text() for source, target in COPIED.items()}
    pages |= {
        "reference/api.md": _api(),
        "reference/configuration.md": _configuration(),
        "reference/metrics.md": _metrics(),
    }
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead links to repository files to their pages, and write formulas as MathML."""
    target = page.file.src_uri
    source = next((each for each, page_of in COPIED.items() if page_of == target), f"docs/{target}")

    def adapted(link: re.Match[str]) -> str:
        mark, text, path, anchor = link[1], link[2], link[3], link[4] or ""
        if "://" in path or path.startswith("mailto:") or not (ROOT / source).exists():
            return link[0]
        file = os.path.normpath(os.path.join(os.path.dirname(source), path))
        place = COPIED.get(file, file.removeprefix("docs/") if file.startswith("docs/") else "")
        page_file = files.get_file_from_path(place) if place else None
        if page_file is None or page_file.inclusion.is_excluded():
            return text  # a file of the repository that the site does not show
        return f"{mark}[{text}]({os.path.relpath(place, os.path.dirname(target) or '.')}{anchor})"

    markdown = re.sub(r"^(```\w+) .*$", r"\1", markdown, flags=re.MULTILINE)  # `json example`
    markdown = re.sub(r"^```math\n(.*?)^```", r"$$\1$$", markdown, flags=re.DOTALL | re.MULTILINE)
    parts = _CODE.split(markdown)
    parts[::2] = [_MATHS.sub(_mathml, part) for part in parts[::2]]
    # Link texts may contain code, so links are replaced in the whole page, outside code blocks.
    blocks = re.split(r"(^```.*?^```)", "".join(parts), flags=re.DOTALL | re.MULTILINE)
    blocks[::2] = [_LINK.sub(adapted, block) for block in blocks[::2]]
    return "".join(blocks)


def _mathml(found: re.Match[str]) -> str:
    formula = convert(found[1] or found[2], display="block" if found[1] else "inline")
    text = " ".join(formula.split())
    # Without a span, a formula at the start of a line would be a block of its own.
    return f'<div class="formula">{text}</div>' if found[1] else f"<span>{text}</span>"


def _api() -> str:
    parts = ["# Python API\n"]
    for title, names in API.items():
        parts += [f"## {title}\n", *(f"::: pliant.{name}\n" for name in names)]
    return "\n".join(parts)


def _configuration() -> str:
    parts = [
        "# Configuration\n\nFields of the YAML files, and keys of `--set`. "
        "Nested fields are written with a dot.\n"
    ]
    for command, cls in SETTINGS.items():
        parts += [f"## `{command}`\n", "| field | meaning | type | default |\n|---|---|---|---|"]
        parts += ["\n".join(_rows(cls)) + "\n"]
    return "\n".join(parts)


def _rows(cls: type[Settings], prefix: str = "") -> Iterator[str]:
    """Yield a row of a table for every setting that is not itself a group of settings."""
    attributes = (cls.__doc__ or "").partition("Attributes:")[2]
    meaning = dict(re.findall(r"^ {8}(\w+): ((?:.|\n {9,})*)", attributes, re.MULTILINE))
    for name, field in cls.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, Settings):
            yield from _rows(field.annotation, f"{prefix}{name}.")
            continue
        kind = _kind(field.annotation, field.metadata)
        unit = unit_of(name)
        shown = f"{kind}, {unit}" if unit else kind
        default = field.get_default(call_default_factory=True)
        yield f"| `{prefix}{name}` | {_cell(meaning.get(name))} | {shown} | {_default(default)} |"


def _kind(hint: Any, metadata: Sequence[Any] = ()) -> str:
    """Return a type in words, with the names or the bounds of its constraints."""
    arguments = get_args(hint)
    if get_origin(hint) is Annotated:
        return _kind(arguments[0], arguments[1:])
    if get_origin(hint) is Literal:
        return ", ".join(f"`{value}`" for value in arguments)
    if get_origin(hint) in (Union, UnionType):
        return " or ".join(_kind(each) for each in arguments)
    for constraint in metadata:
        if isinstance(constraint, OneOf):
            return ", ".join(f"`{name}`" for name in constraint.names)
    base = get_origin(hint) or hint
    word = next((word for kind, word in _WORDS.items() if issubclass(base, kind)), "mapping")
    bounds = next((f" {each}" for each in metadata if isinstance(each, Bounds)), "")
    return f"{word}{bounds}"


def _default(value: Any) -> str:
    if value is PydanticUndefined:
        return ""
    return "none" if value in (None, "", (), {}) else f"`{settings_to_dict(value)}`"


def _metrics() -> str:
    parts = ["# Metrics\n\nThe metrics of each protocol, in the order of a report.\n"]
    for name in PROTOCOL_NAMES:
        protocol = read_protocol(name)
        parts += [
            f"## Protocol `{name}`\n\n{protocol.summary}\n",
            "| metric | meaning | unit | better |\n|---|---|---|---|",
            "\n".join(_metric(each) for each in protocol.figures.values()) + "\n",
        ]
    return "\n".join(parts)


def _metric(figure: Figure) -> str:
    return f"| `{figure.name}` | {_cell(figure.about)} | {figure.unit} | {figure.better} |"


def _cell(text: str | None) -> str:
    return " ".join((text or "").split()).replace("|", "\\|")
