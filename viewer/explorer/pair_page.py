"""The explorer of one pair inside a page without a server: recorded answers at its queries."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Final

from pliant.evaluator.report.pages import data_uri
from pliant.spec.dataset import Dataset
from pliant.spec.queries import QueryPair
from pliant.viewer.explorer.documents import answer_document
from pliant.viewer.explorer.frames import FrameCache
from pliant.viewer.explorer.layers import ERROR_SCALE_PX, frame_layer, png
from pliant.viewer.explorer.recorded import REACH_PX, RecordedQueries
from pliant.viewer.explorer.submissions import read_submission
from pliant.viewer.explorer.truth import TruthFinder

_LAYERS: Final = ("rgb", "index")
_MODULES: Final = ("api", "state", "pictures", "readout", "pair")
_OTHER_CSS: Final = """
.bar { justify-content: start; color: inherit; }
#pictures { max-width: none; }
#previous, #next, #swap, .bar .range, tbody small { display: none; }
:is(th, td):is(:nth-child(2), :nth-child(n + 6)) { display: none; }
table { width: auto; } tbody th { white-space: normal; }
"""
"""Hides what needs a server, and the columns that recorded answers leave empty."""


def pair_section(dataset: Dataset, pair: QueryPair, submissions: Mapping[str, Path]) -> str:
    """Return the explorer of a pair as HTML elements, for one place of a page of the reports.

    Args:
        dataset: A dataset with surface images and truth.
        pair: A pair with queries.
        submissions: Name of a method -> its submission to the pair's split.

    Raises:
        SubmissionError: A submission is damaged.
    """
    queries = RecordedQueries(dataset)
    truth = TruthFinder(FrameCache(dataset), queries)
    methods = [read_submission(path, dataset, queries) for path in submissions.values()]
    places = [pair.at(uv_px) for uv_px in pair.uv_a_px]
    found = [truth.find(each) for each in places]
    document = {
        "dataset": {
            "a": pair.source.key,
            "b": pair.target.key,
            "size": list(dataset.size),
            "methods": [{"name": name, "kind": "recorded"} for name in submissions],
            "layers": _LAYERS,
            "error_scale_px": ERROR_SCALE_PX,
        },
        "layers": {
            frame.key: {
                name: data_uri(png(image))
                for name in _LAYERS
                if (image := frame_layer(frame, name)) is not None
            }
            for frame in (pair.source, pair.target)
        },
        "queries": pair.uv_a_px.round(2).tolist(),
        "reach_px": REACH_PX,
        "truth": [None if each is None else each.as_document() for each in found],
        "answers": [[answer_document(truth, each, at) for at in places] for each in methods],
    }
    return _elements(json.dumps(document).replace("<", "\\u003c"))


def _elements(document: str) -> str:
    """Return the comparison of the explorer's own page, with its style and scripts inside."""
    folder = resources.files("pliant.viewer.explorer") / "static"
    page, css = ((folder / name).read_text("utf-8") for name in ("index.html", "explorer.css"))
    compare: Any = re.search(r'<section id="compare".*?>(.*?)</section>', page, re.DOTALL)
    imports = {}
    for name in _MODULES:  # a module inside a page has no address that "./" could start from
        text = (folder / f"{name}.js").read_text("utf-8").replace('from "./', 'from "explorer/')
        imports[f"explorer/{name}.js"] = data_uri(text.encode(), "text/javascript")
    return (
        f"<style>#explorer {{ {css}{_OTHER_CSS} }}</style>"
        f'<script type="application/json" id="kept">{document}</script>'
        f'<script type="importmap">{json.dumps({"imports": imports})}</script>'
        f'<div id="explorer">{compare[1]}</div>'
        f'<script type="module">import "explorer/pair.js";</script>'
    )
