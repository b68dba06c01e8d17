"""The small edits that cases are made of.

A step of `cases.yaml` names an edit and what it changes: `{remove: notes.txt}` is
`remove("notes.txt")`.
"""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, Final

import numpy.typing as npt
import OpenEXR
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image

from pliant.spec.conventions import FOOTER_KEY
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage import layout
from tests.conformance.base import relist

Edit = Callable[[Path], None]
Change = Callable[[Any], Any]
"""Changes what it is given in place, or returns what replaces it."""

FOREIGN = Path(__file__).resolve().parents[2] / "spec" / "conformance" / "foreign"

ROPE_TRAIN = "sequences/rope/rope-train-000000"
ROPE_TEST = "sequences/rope/rope-test-000000"

FOLDERS: Final = {
    "ROPE": ROPE_TRAIN,
    "TEST": ROPE_TEST,
    "BARE": "sequences/rope-bare/rope-bare-test-000000",
    "SHEET": "sequences/cloth-1/cloth-1-test-000000",
    "CLOTH": "sequences/cloth-1/cloth-1-train-000000",
}
"""First part of a path in a step -> the sequence of `full`, or for `CLOTH` of `minimal`."""


def whole(path: str) -> str:
    """Return a path of a step, relative to the dataset."""
    first, slash, rest = path.partition("/")
    return FOLDERS.get(first, first) + slash + rest


def remove(path: str) -> Edit:
    """Remove a file or a folder with all it contains."""

    def edit(root: Path) -> None:
        target = root / path
        shutil.rmtree(target) if target.is_dir() else target.unlink()

    return edit


def write(path: str, data: bytes) -> Edit:
    """Write a file of the given bytes."""

    def edit(root: Path) -> None:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_bytes(data)

    return edit


def write_text(path: str, text: str = "text\n") -> Edit:
    """Write a file of characters that are one byte each."""
    return write(path, text.encode("latin-1"))


def write_png(path: str, mode: str, size: Sequence[int] = (64, 48)) -> Edit:
    """Write a black PNG of one of Pillow's modes."""
    stream = io.BytesIO()
    Image.new(mode, (size[0], size[1])).save(stream, "PNG")
    return write(path, stream.getvalue())


def link(path: str, to: str) -> Edit:
    """Replace a file by a symbolic link."""

    def edit(root: Path) -> None:
        (root / path).unlink(missing_ok=True)
        (root / path).symlink_to(to)

    return edit


def copy(path: str, to: str) -> Edit:
    """Write a file's bytes to another place."""
    return lambda root: write(whole(to), (root / path).read_bytes())(root)


def store_as(path: str, writer: str) -> Edit:
    """Replace the truth of `full` by the same table as polars, DuckDB or JavaScript write it."""
    return write(path, (FOREIGN / f"{writer}.parquet").read_bytes())


def swap(path: str, other: str) -> Edit:
    """Exchange the bytes of two files."""

    def edit(root: Path) -> None:
        first, second = (root / path).read_bytes(), (root / whole(other)).read_bytes()
        (root / path).write_bytes(second)
        (root / whole(other)).write_bytes(first)

    return edit


def change_bytes(path: str, change: Callable[[bytes], bytes]) -> Edit:
    """Rewrite a file's bytes."""
    return lambda root: write(path, change((root / path).read_bytes()))(root)


def change_json(path: str, change: Change) -> Edit:
    """Change a JSON document."""

    def edit(root: Path) -> None:
        document = _changed(json.loads((root / path).read_text()), change)
        text = json.dumps(document, indent=1, sort_keys=True)
        (root / path).write_text(text + "\n")

    return edit


def change_table(path: str, change: Callable[[pa.Table], pa.Table], **options: Any) -> Edit:
    """Replace a table by another, with the footer the new one has; options are those of pyarrow."""

    def edit(root: Path) -> None:
        written = {"compression": "zstd", **options}
        pq.write_table(change(pq.read_table(root / path)), root / path, **written)

    return edit


def rewrite(path: str, **options: Any) -> Edit:
    """Write a table again, with options of pyarrow."""
    return lambda root: pq.write_table(pq.read_table(root / path), root / path, **options)


def change_rows(path: str, change: Change) -> Edit:
    """Change the rows of a table; types and footer stay."""
    return change_table(
        path,
        lambda table: pa.Table.from_pylist(
            _changed(table.to_pylist(), change), schema=table.schema
        ),
    )


def change_footer(path: str, change: Change) -> Edit:
    """Change the `pliant` footer object."""

    def footed(table: pa.Table) -> pa.Table:
        content = _changed(json.loads(table.schema.metadata[FOOTER_KEY]), change)
        text = content if isinstance(content, bytes) else json.dumps(content).encode()
        return table.replace_schema_metadata({FOOTER_KEY: text})

    return change_table(path, footed)


def change_exr(
    path: str,
    change: Callable[[dict[str, npt.NDArray[Any]]], Any],
    compression: str = "ZIP_COMPRESSION",
) -> Edit:
    """Change the channels of an EXR file."""

    def edit(root: Path) -> None:
        with OpenEXR.File(str(root / path), True, False, 1) as image:
            channels = {name: part.pixels.copy() for name, part in image.channels().items()}
        header = {"compression": getattr(OpenEXR, compression), "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, _changed(channels, change), 1) as image:
            image.write(str(root / path))

    return edit


def listed(*edits: Edit) -> Edit:
    """Make edits, then bring the checksums of every sequence.json up to date."""

    def edit(root: Path) -> None:
        for one in edits:
            one(root)
        for path in sorted(root.rglob(layout.SEQUENCE_JSON)):
            relist(path.parent, json.loads(path.read_text()))

    return edit


def rebind(path: str) -> Edit:
    """Name the sha256 of a queries file in the truth's footer."""
    truth = path.replace(layout.QUERIES_DIR, layout.TRUTH_DIR)
    return lambda root: change_footer(
        truth, lambda footer: footer.update(queries_sha256=sha256_file(root / path))
    )(root)


def _changed(subject: Any, change: Change) -> Any:
    replaced = change(subject)
    return subject if replaced is None else replaced


def change_document(
    document: Any,
    where: Mapping[str, Any] | None = None,
    pick: float | None = None,
    **changes: Any,
) -> None:
    """Change parsed JSON, or the rows of a table, in place.

    Args:
        document: Nested dictionaries and lists.
        where: Values of the elements that `each` stands for in a place; None for all elements.
        pick: Of these take one alone, so far down their list (0 to 1).
        changes: What is done -> places such as `tiers.0.objects.each.id`, as a list or as a
            mapping of places to values.
    """
    for verb, places in changes.items():
        pairs = places.items() if isinstance(places, Mapping) else ((each, None) for each in places)
        for place, value in pairs:
            for node, key in [*_places(document, str(place), where or {}, pick)][::-1]:
                _AT[verb](node, key, value)


def _places(
    node: Any, place: str, where: Mapping[str, Any], pick: float | None
) -> Iterator[tuple[Any, Any]]:
    """Yield the containers and the keys that a place leads to."""
    head, _, rest = place.partition(".")
    keys: list[Any] = [int(head) if isinstance(node, list) and head != "each" else head]
    if head == "each":
        keys = [
            index
            for index, element in enumerate(node)
            if all(element[name] == value for name, value in where.items())
        ]
        keys = keys if pick is None else [keys[int(pick * len(keys))]]
    for key in keys:
        if rest:
            yield from _places(node[key], rest, where, pick)
        else:
            yield node, key


def _set(node: Any, key: Any, value: Any) -> None:
    """Set a value; a number that YAML has no word for, such as `nan`, is given as text."""
    old = node[key] if isinstance(node, list) else node.get(key)
    node[key] = float(value) if isinstance(old, float) and isinstance(value, str) else value


def _exchange(node: Any, key: Any, _: None) -> None:
    node[key], node[key + 1] = node[key + 1], node[key]


_AT: Final[dict[str, Callable[[Any, Any, Any], None]]] = {
    "set": _set,
    "add": lambda node, key, value: node.__setitem__(key, node[key] + value),
    "scale": lambda node, key, value: node.__setitem__(key, node[key] * value),
    "delete": lambda node, key, _: node.__delitem__(key),
    "append": lambda node, key, value: node[key].append(value),
    "reverse": lambda node, key, _: node[key].reverse(),
    "double": lambda node, key, _: node.insert(key, deepcopy(node[key])),
    "exchange": _exchange,  # with the next element
    "repeat": lambda node, key, value: node.append({**node[key], **(value or {})}),  # at the end
}
"""What `change_document` does at a place."""
