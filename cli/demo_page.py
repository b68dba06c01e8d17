"""The demo's page: gathers tables, pictures and histograms, and writes `report/index.html`."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from PIL import Image

from pliant.evaluator.report.best_matches import BestMatches, best_matches
from pliant.evaluator.report.canvas import Labels
from pliant.evaluator.report.overview import CONTROLS, Column, TierSection, render_overview
from pliant.evaluator.report.plots import histogram_svg
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_table
from pliant.spec.io.writing import replacing

if TYPE_CHECKING:
    from pliant.generator.config import GenerateConfig

HISTOGRAM_METHODS: Final = ("sift", "surf", "orb", "random")
HISTOGRAM_EDGES_PX: Final = np.linspace(0, 400, 21)
FRAMES_SHOWN: Final = 6
NAMES: Final = {"sift": "SIFT", "surf": "SURF", "orb": "ORB"}


def write_page(
    dataset: Dataset,
    config: GenerateConfig,
    scores: Mapping[str, Any],
    matches: Mapping[str, Any],
    split: str,
    out: Path,
) -> Path:
    """Write the page.

    Args:
        dataset: The rendered dataset.
        config: What it was rendered from.
        scores: method -> `scores.json` of its answers, in the table's order.
        matches: method -> `scores.json` of its keypoint matches.
        split: The split that was answered.
        out: The demo's folder, with `submissions/` and `reports/`.

    Returns:
        The page's path.
    """
    columns = [_column(name, each, f"../reports/{name}") for name, each in scores.items()]
    keypoints = [
        _column(name, each, f"../reports/{name}-matches") for name, each in matches.items()
    ]
    sections = [_section(dataset, tier, split, list(matches), out) for tier in config.tiers]
    page = render_overview(
        title="The Pliant demo",
        intro="Ropes and cloths that Blender rendered on this machine, with the exact answer for "
        "every query; classical methods and controls answered the same frozen queries.",
        tables=[
            (columns, "rmse_px", "RMSE in px, every query answered (protocol standard)"),
            (columns, "median_px", "Median error in px"),
            (columns, "pck_16px", "Share of answers within 16 px"),
            (
                keypoints,
                "rmse_px",
                "RMSE in px of the methods' own keypoint matches, which answer "
                "only where a keypoint was found (protocol matches; how the paper scored them)",
            ),
        ],
        tiers=sections,
        facts=_facts(dataset, config, scores),
    )
    path = out / "report" / "index.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial:
        partial.write_text(page, encoding="utf-8")
    return path


def _column(name: str, scores: Mapping[str, Any], folder: str) -> Column:
    method = scores["submission"]["method"]
    ran = f"{method.get('implementation', '')} {method.get('version', '')}".strip()
    return Column(
        name=NAMES.get(name, name),
        note=ran if name not in CONTROLS else "",
        scores=scores,
        href=f"{folder}/report.html",
        control=name in CONTROLS,
    )


def _section(dataset: Dataset, tier: str, split: str, sparse: list[str], out: Path) -> TierSection:
    from pliant.viewer.figures import contact_sheet

    queries = dataset.queries(split)
    mine = np.array(queries["tier"].to_pylist()) == tier
    pairs = np.unique(queries["pair_id"].to_numpy()[mine])
    sequences = [each for each in dataset.sequences if each.tier == tier]
    frames = sum(each.frames for each in sequences)
    return TierSection(
        name=tier,
        facts=f"{len(sequences)} sequences, {frames} images, {len(pairs)} pairs, "
        f"{int(mine.sum())} queries.",
        frames_png=_png(contact_sheet(dataset, sequences, count=FRAMES_SHOWN)),
        histogram_svg=_histogram(dataset, tier, split, out),
        matches_svg={
            _matches_caption(name, best): best.svg
            for name in sparse
            for best in [
                best_matches(
                    dataset, split, out / "submissions" / f"{name}-matches.parquet", int(pairs[0])
                )
            ]
        },
    )


def _png(image: npt.NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _matches_caption(name: str, best: BestMatches) -> str:
    if not best.drawn:
        return f"{NAMES[name]}: no match on this pair"
    return (
        f"{NAMES[name]}: {best.right} of its {best.drawn} best matches within "
        f"{best.radius_px:.0f} px (green)"
    )


def _histogram(dataset: Dataset, tier: str, split: str, out: Path) -> str:
    truth = dataset.truth(split)
    counted = np.array(
        [
            (each, seen) == (tier, "visible")
            for each, seen in zip(
                truth["tier"].to_pylist(), truth["visibility_b"].to_pylist(), strict=True
            )
        ]
    )
    series = {}
    for method in HISTOGRAM_METHODS:
        answers = read_table(out / "submissions" / f"{method}.parquet", "answers")
        error_px = _errors_px(truth, answers)[counted]
        # The last bin takes everything beyond it, so that the shares add up to 1.
        clipped = np.minimum(error_px, HISTOGRAM_EDGES_PX[-1] - 1e-6)
        share = np.histogram(clipped, HISTOGRAM_EDGES_PX)[0] / max(len(error_px), 1)
        series[NAMES.get(method, method)] = share
    labels = Labels(
        f"Errors on {tier}",
        f"error, px (last bin: {HISTOGRAM_EDGES_PX[-2]:.0f} and more)",
        "share of answers",
    )
    return histogram_svg(series, HISTOGRAM_EDGES_PX, labels)


def _errors_px(truth: pa.Table, answers: pa.Table) -> npt.NDArray[np.float64]:
    """Return the distance of every answer to its truth; both tables are in the queries' order."""
    return np.hypot(
        truth["u_b"].to_numpy().astype(np.float64) - answers["u"].to_numpy(),
        truth["v_b"].to_numpy().astype(np.float64) - answers["v"].to_numpy(),
    )


def _facts(dataset: Dataset, config: GenerateConfig, scores: Mapping[str, Any]) -> dict[str, str]:
    first = next(iter(scores.values()))
    tools = dataset.info["provenance"].get("tools", {})
    return {
        "dataset": f"{dataset.id} {dataset.version}, seed {config.seed}, "
        f"{config.width}x{config.height}, style {config.style}",
        "queries": f"sha256 {first['submission'].get('queries_sha256', '')}",
        "made with": ", ".join(f"{name} {version}" for name, version in sorted(tools.items())),
        "again": "pliant demo with the same seed gives the same tables, geometry and scores",
    }
