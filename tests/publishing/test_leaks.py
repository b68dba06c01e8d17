"""Every road to the held-out answers that we could think of, tried on the public half."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import struct
import tarfile
import zlib
from collections.abc import Iterator
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.generator.config import GenerateConfig, QuerySettings
from pliant.generator.runner.run import generate
from pliant.publishing import PublishSettings, publish
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.secrets import read_secret_seed, write_secret_seed
from pliant.spec.storage import layout
from tests.conformance.base import relist
from tests.folders import files_of
from tests.generator.runner.standin import InProcess
from tests.publishing.conftest import HELD_OUT

CHUNKS = {b"IHDR", b"sRGB", b"IDAT", b"IEND"}


CONFIG = GenerateConfig(
    tiers=("rope",),
    splits={"train": 1, "test": 2},
    frames=2,
    width=96,
    height=72,
    style="raster",
    secret_seed=True,
    queries=QuerySettings(pairs_per_sequence=2, queries_per_pair=16),
    id="secret",
)


@pytest.fixture(scope="module")
def secret(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A small set of a secret seed, and its halves: (whole, public, private)."""
    root = tmp_path_factory.mktemp("secret")
    assert not generate(CONFIG, root / "whole", engine=InProcess()).failed
    facts = publish(root / "whole", root / "public", PublishSettings(hold_out=("test",)))
    assert not any("query pixels" in text or "seed" in text for text in facts.warnings)
    return root / "whole", root / "public", root / "public-private"


def contents(root: Path) -> Iterator[tuple[str, bytes]]:
    """Every file, every member of every shard and tar, every PNG's pixels: as bare bytes."""
    for name, data in files_of(root).items():
        yield name, data
        if name.endswith(".tar"):
            with tarfile.open(root / name) as tar:
                for member in tar:
                    stream = tar.extractfile(member)
                    assert stream is not None
                    yield f"{name}:{member.name}", stream.read()
        if name.endswith(".parquet"):
            yield f"{name}:columns", b"".join(_decoded(root / name))
    dataset = Dataset.open(root)
    for sequence in dataset.sequences:
        for path in dataset.files.members(sequence.id):  # type: ignore[attr-defined]
            data = sequence.file(path).data  # type: ignore[union-attr]
            yield f"{sequence.id}/{path}", data
            if path.endswith(".png"):
                parts = [body for kind, body in chunks(data) if kind == b"IDAT"]
                yield f"{sequence.id}/{path}:pixels", zlib.decompress(b"".join(parts))


def _decoded(path: Path) -> Iterator[bytes]:
    """The values of every column of a Parquet file, uncompressed, and its footer's texts."""
    table = pq.read_table(path)
    for column in table.columns:
        for chunk in column.chunks:
            yield from (bytes(buffer) for buffer in chunk.buffers() if buffer is not None)
    yield repr(pq.ParquetFile(path).metadata.metadata).encode()


def chunks(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 8
    while at < len(png):
        (length,) = struct.unpack_from(">I", png, at)
        yield png[at + 4 : at + 8], png[at + 8 : at + 8 + length]
        at += 12 + length


def held(root: Path) -> list[Any]:
    return [s for s in Dataset.open(root).sequences if s.split == "test"]


def test_of_held_out_sequences_there_are_pictures_alone(halves: Any) -> None:
    assert not (halves.public / "truth" / "test.parquet").exists()
    dataset = Dataset.open(halves.public)
    for sequence in held(halves.public):
        pictures = {layout.rgb_name(frame) for frame in range(sequence.frames)}
        members = dataset.files.members(sequence.id)  # type: ignore[attr-defined]
        assert set(members) == pictures | {layout.SEQUENCE_JSON}
        assert {entry["path"] for entry in sequence.info["files"]} == pictures
        assert sequence.info["parameters"] == {}
        assert sequence.info["frame_info"] == [{}] * sequence.frames
        for read in (sequence.points, sequence.correspondences, lambda s=sequence: s.surface(0)):
            with pytest.raises(SpecError, match="not there"):
                read()
    frames = pq.read_table(halves.public / "frames" / "test-00000.parquet")
    for name in ("depth_exr", "fx", "fy", "cx", "cy", "world_to_camera"):
        assert frames[name].null_count == len(frames)
    assert not list(halves.public.glob("correspondences/test-*"))
    for row in pq.read_table(halves.public / "sequences.parquet").to_pylist():
        if row["split"] == "test":
            told = [row[name] for name in ("seed", "coverage", "self_occluded", "shape")]
            assert told == [0, None, 0.0, None]
    assert set(frames["shape"].to_pylist()) == {None}
    assert {s.info["shape"] for s in held(halves.public)} == {None}
    assert any(s.shape for s in held(halves.whole))


def test_no_position_stands_anywhere_in_the_bytes(secret: Any) -> None:
    """Neither the answers nor any tracked point's place in a held-out frame, in any encoding."""
    whole, public, _ = secret
    truth = Dataset.open(whole).truth("test")
    asked = set(_pairs(Dataset.open(whole).queries("test"), "u_a", "v_a"))
    pairs = _pairs(truth, "u_b", "v_b")
    for sequence in held(whole):
        table = sequence.correspondences()
        pairs += [*_pairs(table, "u_px", "v_px")[::37], *_pairs(table, "x_m", "y_m")[::37]]
    pairs = [pair for pair in pairs if pair not in asked]
    assert len(pairs) > 150
    needles = [struct.pack("<ff", *pair) for pair in pairs] + [
        f"{value!r}".encode() for pair in pairs[:40] for value in pair
    ]
    pattern = re.compile(b"|".join(re.escape(needle) for needle in needles))
    for name, data in contents(public):
        found = pattern.search(data)
        assert found is None, f"{name} holds {found}"
    # The search does find them where they are: side by side in memory.
    assert pattern.search(np.stack([truth["u_b"], truth["v_b"]], axis=1).tobytes())


def _pairs(table: pa.Table, *names: str) -> list[tuple[float, ...]]:
    return list(zip(*(table[name].to_pylist() for name in names), strict=True))


def test_no_pair_of_columns_holds_an_answer(secret: Any) -> None:
    """Every two numeric columns of every public table, row by row, against the held-out places."""
    whole, public, _ = secret
    truth = Dataset.open(whole).truth("test")
    wanted = set(_records(truth["u_b"], truth["v_b"]).tolist())
    for sequence in held(whole):
        table = sequence.correspondences()
        wanted |= set(_records(table["u_px"], table["v_px"]).tolist())
    asked = Dataset.open(whole).queries("test")
    allowed = set(_records(asked["u_a"], asked["v_a"]).tolist())
    checked = 0
    for path in public.rglob("*.parquet"):
        table = pq.read_table(path)
        floats = [
            name
            for name in table.column_names
            if pa.types.is_floating(table[name].type) and not table[name].null_count
        ]
        for first, second in permutations(floats, 2):
            checked += 1
            seen = set(_records(table[first], table[second]).tolist())
            if path.parent.name == "queries":
                seen -= allowed  # the questions themselves are public
            assert not seen & wanted, (path, first, second)
    assert checked > 20
    # And where the answers do lie, this very comparison finds them.
    table = held(whole)[0].correspondences()
    assert set(_records(table["u_px"], table["v_px"]).tolist()) & wanted


def _records(u: Any, v: Any) -> Any:
    parts = [np.asarray(c.to_numpy(), np.float32).view(np.uint32).astype(np.uint64) for c in (u, v)]
    return parts[0] << np.uint64(32) | parts[1]


def test_statistics_and_footers_tell_nothing(secret: Any) -> None:
    whole, public, _ = secret
    truth = Dataset.open(whole).truth("test")
    bounds = {value for name in ("u_b", "v_b") for value in truth[name].to_pylist()}
    asked = Dataset.open(public).queries("test")
    bounds -= {value for name in ("u_a", "v_a") for value in asked[name].to_pylist()}
    for path in public.rglob("*.parquet"):
        metadata = pq.ParquetFile(path).metadata
        for group in range(metadata.num_row_groups):
            for index in range(metadata.num_columns):
                column = metadata.row_group(group).column(index)
                if column.path_in_schema in ("image.bytes", "depth_exr", "content"):
                    assert column.statistics is None
                elif column.statistics is not None and column.statistics.has_min_max:
                    assert column.statistics.min not in bounds or path.parts[-2] != "queries"
        footer = json.loads(metadata.metadata[b"pliant"])
        assert set(footer) <= {"spec_version", "table", "dataset", "split", "queries_sha256"}
        assert set(metadata.metadata) <= {b"pliant", b"huggingface", b"ARROW:schema"}


def test_pictures_hold_pixels_alone(halves: Any) -> None:
    for sequence in held(halves.public):
        for frame in range(sequence.frames):
            data = sequence.file(layout.rgb_name(frame)).data
            found = list(chunks(data))
            assert {kind for kind, _ in found} <= CHUNKS
            assert found[-1][0] == b"IEND"
            height, width, channels = sequence.rgb(frame).shape
            pixels = zlib.decompress(b"".join(body for kind, body in found if kind == b"IDAT"))
            assert len(pixels) == height * (width * channels + 1)


def test_what_hides_in_a_picture_is_taken_out(halves: Any, tmp_path: Path) -> None:
    """An image from outside may carry text, a time, a profile, or bytes behind its end."""
    root = tmp_path / "whole"
    shutil.copytree(halves.whole, root)
    folder = next(root.glob("sequences/rope/rope-test-*"))
    path = folder / "rgb" / "000000.png"
    clean = path.read_bytes()
    text = b"pose\0" + b"0.25 0.5 1.75"
    extra = struct.pack(">I", len(text)) + b"tEXt" + text
    extra += struct.pack(">I", zlib.crc32(b"tEXt" + text))
    path.write_bytes(clean[:33] + extra + clean[33:] + b"the answer is 42")
    relist(folder, read_json(folder / layout.SEQUENCE_JSON))
    publish(root, tmp_path / "out", HELD_OUT)
    published = Dataset.open(tmp_path / "out").sequence(folder.name)
    assert published.file("rgb/000000.png").data == clean  # type: ignore[union-attr]


def test_checksums_of_the_answers_are_nowhere(secret: Any) -> None:
    """A checksum would let a guess be proven right, file by file."""
    _, public, private = secret
    digests = {
        hashlib.sha256(data).hexdigest()
        for name, data in files_of(private).items()
        if name not in (layout.CHECKSUMS, layout.MANIFEST_JSON)
    }
    assert len(digests) > 10
    pattern = re.compile("|".join(digests).encode())
    raw = [bytes.fromhex(digest) for digest in digests]
    for name, data in contents(public):
        assert pattern.search(data) is None, name
        assert not any(each in data for each in raw), name
    assert pattern.search((private / layout.CHECKSUMS).read_bytes())


def test_the_seed_is_nowhere(secret: Any) -> None:
    """Nor in the private half, which scores without it."""
    whole, public, private = secret
    seed = read_secret_seed(whole)
    assert seed is not None
    needles = [str(seed).encode(), f"{seed:x}".encode()]
    needles += [seed.to_bytes(16, order) for order in ("little", "big")]
    for root, texts in ((public, contents(public)), (private, files_of(private).items())):
        for name, data in texts:
            assert not any(needle in data for needle in needles), name
            if root == public and name.endswith(".json"):
                assert all(each in (0, None) for each in seeds_in(json.loads(data))), name
        assert not list(root.rglob(".private"))
        rows = pq.read_table(root / "sequences.parquet")
        assert set(rows["seed"].to_pylist()) == {0}


def seeds_in(value: Any) -> Iterator[Any]:
    """Every field whose name speaks of a seed."""
    if isinstance(value, dict):
        for key, item in value.items():
            if "seed" in key.lower():
                yield item
            yield from seeds_in(item)
    elif isinstance(value, list):
        for item in value:
            yield from seeds_in(item)


def test_nobody_can_generate_the_answers_again(secret: Any, tmp_path: Path) -> None:
    """The same call with the seed that the public half tells gives another set; with the secret
    one, the same."""
    whole, public, _ = secret
    right = (whole / "truth" / "test.parquet").read_bytes()
    provenance = json.loads((public / "dataset.json").read_text())["provenance"]
    assert provenance["seed"] is None
    seed = read_secret_seed(whole)
    assert seed is not None
    write_secret_seed(tmp_path / "known", seed)
    configs = {"guess": CONFIG.replace(secret_seed=False, seed=0), "known": CONFIG}
    for name, config in configs.items():
        assert not generate(config, tmp_path / name, engine=InProcess()).failed
        found = (tmp_path / name / "truth" / "test.parquet").read_bytes()
        assert (found == right) is (name == "known")


def test_the_validator_would_notice(secret: Any, tmp_path: Path) -> None:
    from pliant.spec.validation.validate import validate

    _, public, private = secret
    root = tmp_path / "public"
    shutil.copytree(public, root)
    # The secret seed differs in every run, and the colours of some seeds give a warning.
    doubts = validate(root).counts
    (root / "truth").mkdir(exist_ok=True)
    shutil.copy(private / "truth" / "test.parquet", root / "truth")
    assert set(doubts) <= {"COLOUR_DOUBTFUL"}
    assert validate(root).counts == {**doubts, "FILE_UNLISTED": 1, "HELD_OUT_LEAKS": 1}
