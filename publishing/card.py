"""The dataset card: `README.md` with the YAML that Hugging Face reads, pictures and figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice, zip_longest
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import yaml
from PIL import Image
from rich.filesize import decimal

from pliant.evaluator.report.contact_sheet import contact_sheet
from pliant.evaluator.report.pages import render_page
from pliant.publishing import pairs
from pliant.publishing.papers import keywords, licence_url
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_table
from pliant.spec.io.writing import write_file
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage import layout
from pliant.spec.storage.packing import FRAMES, ROWS, hub_features
from pliant.spec.text import plural

_PICTURES: Final = 12
_QUALITY: Final = 88


def write_card(dataset: Dataset, root: Path, *, authors: Sequence[str], url: str | None) -> None:
    """Write `README.md` and the pictures it shows.

    Args:
        dataset: The public half, packed.
        root: Its folder.
        authors: Names of the publishers.
        url: URL of the published dataset, or None.
    """
    info = dataset.info
    header = yaml.safe_dump(
        _front_matter(dataset, root), sort_keys=False, allow_unicode=True, width=100
    )
    text = render_page(
        "dataset_card.md.j2",
        package="pliant.publishing",
        front_matter=header,
        info={**info, "id": dataset.id, "version": dataset.version},
        kinds=" and ".join(sorted({tier.kind for tier in dataset.tiers.values()})),
        size=dataset.size,
        recorded=is_recorded(dataset),
        pictures=_draw(dataset, root),
        tiers=_tiers(dataset),
        held_out=list(dataset.held_out),
        shown=any(s.split not in dataset.held_out for s in dataset.sequences),
        asked=[_asked(dataset, split) for split in dataset.splits_with_queries()],
        files=list(_files(root)),
        first=dataset.sequences[0],
        columns=ROWS.names,
        url=url,
        queries_sha256=dataset.queries_sha256,
        licence_url=licence_url(info["licence"]),
        authors=authors,
    )
    write_file(root / "README.md", text)


def is_recorded(dataset: Dataset) -> bool:
    """Return whether its points were annotated: the material of its tiers is unknown.

    Args:
        dataset: The dataset.
    """
    axes = [
        axis.name
        for tier in dataset.tiers.values()
        for each in tier.objects
        for axis in each.material
    ]
    return "unknown" in axes


def _draw(dataset: Dataset, root: Path) -> list[tuple[str, str]]:
    """Draw the pictures of the card; return (file, caption). Held-out surfaces are not shown."""
    folder = root / layout.PICTURES_DIR
    folder.mkdir()
    made = []
    open_ones = [s for s in dataset.sequences if s.split not in dataset.held_out]
    for split in dataset.held_out:
        chosen = [s for s in dataset.sequences if s.split == split]
        sheet = contact_sheet(dataset, chosen, "rgb", _PICTURES)
        _save(sheet, folder / f"{split}.jpg")
        made.append((f"{split}.jpg", f"Frames of the split {split}, whose answers are held out."))
    if open_ones:
        sheet = contact_sheet(dataset, _spread(open_ones), "sheet", _PICTURES)
        _save(sheet, folder / "overview.jpg")
        caption = "Frames; below each the material coordinate as colour, and depth."
        made.insert(0, ("overview.jpg", caption))
    return made


def _spread(sequences: Sequence[SequenceRecord]) -> list[SequenceRecord]:
    """Return sequences taken from all tiers in turn, ordered by tier."""
    tiers: dict[str, list[SequenceRecord]] = {}
    for sequence in sequences:
        tiers.setdefault(sequence.tier, []).append(sequence)
    turns = chain.from_iterable(zip_longest(*tiers.values()))
    first = list(islice((each for each in turns if each is not None), _PICTURES))
    return sorted(first, key=lambda sequence: list(tiers).index(sequence.tier))


def _save(image: Any, path: Path) -> None:
    Image.fromarray(image).save(path, "JPEG", quality=_QUALITY)


def configurations(dataset: Dataset, root: Path) -> list[dict[str, Any]]:
    """Return the `configs` of the card: which files make up which table.

    Args:
        dataset: The public half.
        root: Its folder.
    """
    asked = dataset.splits_with_queries()
    answered = [split for split in asked if dataset.has(layout.truth_name(split))]
    found = [
        ("queries", [(split, layout.queries_name(split)) for split in asked]),
        ("truth", [(split, layout.truth_name(split)) for split in answered]),
        ("pairs", [(split, layout.pairs_name(split)) for split in answered]),
        ("correspondences", _sharded(root, "correspondences", dataset)),
        ("frames", _sharded(root, "frames", dataset)),
    ]
    configs: list[dict[str, Any]] = [
        {
            "config_name": name,
            "data_files": [{"split": split, "path": path} for split, path in files],
        }
        for name, files in found
        if files
    ]
    configs[0]["default"] = True
    return configs


def _sharded(root: Path, folder: str, dataset: Dataset) -> list[tuple[str, str]]:
    return [
        (split, f"{folder}/{split}-*.parquet")
        for split in dataset.info["splits"]
        if any(root.glob(f"{folder}/{split}-*.parquet"))
    ]


def _front_matter(dataset: Dataset, root: Path) -> dict[str, Any]:
    frames = sum(sequence.frames for sequence in dataset.sequences)
    licence = str(dataset.info["licence"]).lower()
    listed = licence_url(dataset.info["licence"]) is not None
    return {
        **({"license": licence} if listed else {"license": "other", "license_name": licence}),
        "pretty_name": dataset.info["title"],
        "task_categories": ["keypoint-detection", "image-feature-extraction"],
        "tags": ["pliant", *keywords(dataset.info)],
        "size_categories": [_size_category(frames)],
        "configs": configurations(dataset, root),
        "dataset_info": [
            {
                "config_name": name,
                "features": [
                    {"name": column, **_feature(kind)}
                    for column, kind in hub_features(schema).items()
                ],
            }
            for name, schema in (("frames", FRAMES), ("pairs", pairs.SCHEMA))
            if (root / name).is_dir()
        ],
    }


def _feature(kind: Mapping[str, Any]) -> dict[str, Any]:
    """Return a feature in the card's own notation."""
    if kind["_type"] == "Image":
        return {"dtype": "image"}
    if kind["_type"] == "List":
        return {"list": kind["feature"]["dtype"]}
    return {"dtype": kind["dtype"]}


def _size_category(rows: int) -> str:
    bounds = [(10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M")]
    return next((name for bound, name in bounds if rows < bound), "1M<n<10M")


def _tiers(dataset: Dataset) -> list[list[str]]:
    """Return the cells of each tier: its name, frames per split, points, coverage, occlusion."""
    table = read_table(dataset.local(layout.SEQUENCES_TABLE), "sequences")
    held_out = pa.array(list(dataset.held_out), pa.string())
    rows = []
    for name in dataset.tiers:
        own = table.filter(pc.equal(table["tier"], name))
        cells = [name]
        for split in dataset.info["splits"]:
            part = own.filter(pc.equal(own["split"], split))
            cells.append(f"{len(part):,}, {pc.sum(part['frames']).as_py() or 0:,}")
        opened = own.filter(pc.invert(pc.is_in(own["split"], held_out)))
        mine = [s for s in dataset.sequences if s.tier == name and s.split not in dataset.held_out]
        cells.append(f"{mine[0].points().num_rows:,}" if mine else "-")
        rows.append([*cells, _mean(opened["coverage"]), _mean(opened["self_occluded"])])
    return rows


def _mean(column: Any) -> str:
    if len(column) == column.null_count:
        return "-"
    return f"{pc.mean(column).as_py():.2f}"


def _asked(dataset: Dataset, split: str) -> dict[str, Any]:
    table = read_table(dataset.local(layout.queries_name(split)), "queries", ["pair_id"])
    if split in dataset.held_out:
        answers = "answers held out"
    elif dataset.has(layout.truth_name(split)):
        answers = "answers in `truth`"
    else:
        answers = "no answers here"
    pairs = pc.count_distinct(table["pair_id"]).as_py()
    return {"name": split, "queries": len(table), "pairs": pairs, "answers": answers}


def _files(root: Path) -> Iterator[tuple[str, int, str]]:
    """Yield name, rows and size of each table."""
    tables = {name: [root / name] for name in (layout.SEQUENCES_TABLE, layout.INDEX_TABLE)}
    for folder in (layout.QUERIES_DIR, layout.TRUTH_DIR, layout.PAIRS_DIR, *layout.SHARD_DIRS):
        if paths := sorted((root / folder).glob("*.parquet")):
            tables[f"{folder}/ ({plural(len(paths), 'file')})"] = paths
    for name, paths in tables.items():
        rows = sum(pq.ParquetFile(path).metadata.num_rows for path in paths)
        yield name, rows, decimal(sum(path.stat().st_size for path in paths))
