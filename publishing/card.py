"""The dataset card: `README.md` with the YAML that Hugging Face reads, pictures and figures."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow.compute as pc
import pyarrow.parquet as pq
import yaml
from PIL import Image

from pliant.publishing.papers import licence_url
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_table
from pliant.spec.storage import layout
from pliant.spec.storage.packing import FEATURES, ROWS
from pliant.viewer.figures import contact_sheet

_PICTURES: Final = 12
_QUALITY: Final = 88


def write_card(dataset: Dataset, root: Path, *, authors: Sequence[str], url: str | None) -> None:
    """Write `README.md` and the pictures it shows.

    Args:
        dataset: The public half, packed.
        root: Its folder.
        authors: Who publishes it.
        url: Where it will be hosted, or None.
    """
    pictures = _draw(dataset, root)
    header = yaml.safe_dump(
        _front_matter(dataset, root), sort_keys=False, allow_unicode=True, width=100
    )
    text = f"---\n{header}---\n\n{_body(dataset, root, pictures, authors, url)}"
    (root / "README.md").write_bytes(text.encode("utf-8"))


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


def _spread(sequences: Sequence[Any]) -> list[Any]:
    """Order sequences so that the first of every tier come first."""
    rank: dict[str, int] = {}
    ranked = []
    for sequence in sequences:
        rank[sequence.tier] = rank.get(sequence.tier, -1) + 1
        ranked.append((rank[sequence.tier], sequence))
    first = sorted(ranked, key=lambda item: item[0])[:_PICTURES]
    tiers = list(rank)
    chosen = sorted(first, key=lambda item: (tiers.index(item[1].tier), item[0]))
    return [sequence for _, sequence in chosen]


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
    features = [{"name": name, **_feature(kind)} for name, kind in FEATURES.items()]
    return {
        "license": str(dataset.info["licence"]).lower(),
        "pretty_name": dataset.info["title"],
        "task_categories": ["keypoint-detection", "image-feature-extraction"],
        "tags": ["pliant", "dense correspondence", "deformable objects", "rope", "cloth"],
        "size_categories": [_size_category(frames)],
        "configs": configurations(dataset, root),
        "dataset_info": [{"config_name": "frames", "features": features}],
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


def _body(
    dataset: Dataset,
    root: Path,
    pictures: Sequence[tuple[str, str]],
    authors: Sequence[str],
    url: str | None,
) -> str:
    info = dataset.info
    held = dataset.held_out
    width, height = dataset.size
    kinds = " and ".join(sorted({tier["kind"] for tier in info["tiers"]}))
    parts = [f"# {info['title']}\n"]
    if info["description"]:
        parts.append(f"{textwrap.fill(info['description'], 100)}\n")
    parts.append(
        f"Given a pixel on a deformable object ({kinds}) in one image: where is the same material\n"
        f"point in another? Images of {width} x {height} pixels; the answers are exact.\n"
    )
    parts += [f"![{text}](pictures/{name})\n\n*{text}*\n" for name, text in pictures]
    parts.append("## What is in it\n\n" + _counts(dataset) + "\n" + _queries(dataset))
    parts.append(_files(root))
    parts.append(_loading(dataset, url))
    parts.append(_submitting(dataset, held))
    parts.append(
        "## Licence and citation\n\n"
        f"[{info['licence']}]({licence_url(info['licence'])}); see `LICENSE`. Published by "
        f"{', '.join(authors)}; cite it by `CITATION.cff`.\n\n"
        f"Made with {info['provenance']['generator']}, by the Pliant dataset format "
        f"{info['spec_version']}; id `{dataset.id}`, version {dataset.version}. `sha256sum -c "
        "SHA256SUMS`\nsays whether a copy is whole.\n"
    )
    return "\n".join(parts)


def _counts(dataset: Dataset) -> str:
    table = read_table(dataset.local(layout.SEQUENCES_TABLE), "sequences")
    splits = list(dataset.info["splits"])
    lines = [
        "| tier | "
        + " | ".join(f"{split}: sequences, frames" for split in splits)
        + " | points | coverage | self-occluded |",
        "|---|" + "---|" * len(splits) + "---|---|---|",
    ]
    for name in dataset.tiers:
        rows = table.filter(pc.equal(table["tier"], name))
        cells = []
        for split in splits:
            part = rows.filter(pc.equal(rows["split"], split))
            frames = pc.sum(part["frames"]).as_py() or 0
            cells.append(f"{len(part):,}, {frames:,}")
        open_rows = rows.filter(pc.invert(pc.is_in(rows["split"], _texts(dataset.held_out))))
        mine = [s for s in dataset.sequences if s.tier == name and s.split not in dataset.held_out]
        points = f"{mine[0].points().num_rows:,}" if mine else "-"
        lines.append(
            f"| {name} | " + " | ".join(cells) + f" | {points} | "
            f"{_mean(open_rows['coverage'])} | {_mean(open_rows['self_occluded'])} |"
        )
    over = ", means"
    if dataset.held_out:
        over += f" over the splits that are not held out ({', '.join(dataset.held_out)} is)"
    note = (
        "\nCoverage is silhouette over flat area, self-occluded the share of points that the "
        f"object itself\nhides{over}.\n"
    )
    return "\n".join(lines) + "\n" + note


def _texts(values: Sequence[str]) -> Any:
    import pyarrow as pa

    return pa.array(list(values), pa.string())


def _mean(column: Any) -> str:
    if len(column) == column.null_count:
        return "-"
    return f"{pc.mean(column).as_py():.2f}"


def _queries(dataset: Dataset) -> str:
    lines = []
    for split in dataset.splits_with_queries():
        table = read_table(dataset.local(layout.queries_name(split)), "queries", ["pair_id"])
        pairs = pc.count_distinct(table["pair_id"]).as_py()
        answers = "answers held out" if split in dataset.held_out else "answers in `truth`"
        if split not in dataset.held_out and not dataset.has(layout.truth_name(split)):
            answers = "no answers here"
        lines.append(f"- `{split}`: {len(table):,} queries in {pairs:,} image pairs, {answers}\n")
    return "".join(lines)


def _files(root: Path) -> str:
    lines = ["| file | rows | size |", "|---|---|---|"]
    names = [layout.SEQUENCES_TABLE, layout.INDEX_TABLE]
    for name in names:
        lines.append(_file_row(root, name, [root / name]))
    for folder in (layout.QUERIES_DIR, layout.TRUTH_DIR, *layout.SHARD_DIRS):
        paths = sorted((root / folder).glob("*.parquet"))
        if paths:
            lines.append(_file_row(root, f"{folder}/ ({len(paths)} files)", paths))
    return "\n".join(lines) + "\n"


def _file_row(root: Path, name: str, paths: Sequence[Path]) -> str:
    rows = sum(pq.ParquetFile(path).metadata.num_rows for path in paths)
    size = sum(path.stat().st_size for path in paths)
    return f"| `{name}` | {rows:,} | {_size(size)} |"


def _size(count: int) -> str:
    power = next((p for p in (3, 2, 1) if count >= 1000**p), 0)
    return f"{count / 1000**power:,.{1 if power else 0}f} {('B', 'kB', 'MB', 'GB')[power]}"


def _loading(dataset: Dataset, url: str | None) -> str:
    first = dataset.sequences[0]
    columns = ", ".join(f"`{name}`" for name in ROWS.names)
    return f"""\
## How to load it

With Hugging Face `datasets`, no script and no Pliant (`DIR`: this folder, or its name on the Hub):

```python
from datasets import load_dataset

frames = load_dataset("DIR", "frames", split="{first.split}")
frames[0]["image"]               # a picture
queries = load_dataset("DIR")    # the questions
```

`correspondences` has the columns {columns}.

With Pliant, from a folder or streamed from a URL that `fsspec` knows (`hf://`, `s3://`,
`https://`):

```python
from pliant.spec.dataset import Dataset

dataset = Dataset.open("{url or "DIR"}")
dataset.sequence("{first.id}").rgb(0)    # uint8 (H, W, 3)
```

Pixels: (u, v) from the outer corner of the top-left pixel, whose centre is (0.5, 0.5). All
conventions stand in `dataset.json`; `croissant.json` describes the tables for machines.
"""


def _submitting(dataset: Dataset, held: Sequence[str]) -> str:
    asked = dataset.splits_with_queries()
    if not asked:
        return ""
    split = held[0] if held else asked[-1]
    after = (
        f"The answers of {', '.join(held)} are\nwith the publisher, who scores it by "
        "`pliant evaluate SUB.parquet --data DIR --truth PRIVATE`."
        if held
        else "Score it by\n`pliant evaluate SUB.parquet --data DIR --out REPORT`."
    )
    return f"""\
## How to answer

A submission is one Parquet file with a row for every row of `queries/{split}.parquet`: its
`pair_id` and `query_id`, and where the point is in frame B, `u` and `v`, in pixels (optionally
`visible`, `sigma` or `modes`). Its footer has under the key `pliant`:

```json
{{"spec_version": "{dataset.info["spec_version"]}", "table": "answers",
 "dataset": {{"id": "{dataset.id}", "version": "{dataset.version}"}}, "split": "{split}",
 "queries_sha256": "{dataset.queries_sha256(split)}",
 "method": {{"name": "yours"}}}}
```

`pliant check SUB.parquet --data DIR` lists whatever is wrong with it. {after}
"""
