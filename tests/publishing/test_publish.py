"""What `pliant publish` writes: valid, whole, tied together, the same everywhere."""

from __future__ import annotations

import hashlib
import html
import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from markdown_it import MarkdownIt
from PIL import Image

from pliant.cli.main import run
from pliant.evaluator.report.pages import environment
from pliant.publishing import PublishSettings, publish
from pliant.publishing.card import write_card
from pliant.publishing.papers import citation, zenodo
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.reading import read_bytes
from pliant.spec.storage import layout
from pliant.spec.storage.manifest import read_checksums
from pliant.spec.validation.validate import validate
from tests.conftest import Refused
from tests.folders import files_of
from tests.publishing.conftest import HELD_OUT, SETTINGS, printed
from tests.publishing.croissant_check import croissant_problems


def sums(root: Path) -> str:
    return (root / layout.CHECKSUMS).read_text()


def changed_files(whole: Dataset, published: Dataset) -> set[str]:
    """Return SPLIT/NAME of the files of sequences that are not as they were."""
    return {
        f"{ours.split}/{name}"
        for ours, theirs in zip(whole.sequences, published.sequences, strict=True)
        for name, data in files_of(ours.dir).items()
        if read_bytes(theirs.file(name), 2**30) != data
    }


def test_both_halves_are_whole_and_name_each_other(halves: Any) -> None:
    assert validate(halves.public).counts == {}
    names = {}
    for root, half in ((halves.public, "public"), (halves.private, "private")):
        listed = read_checksums(root / layout.CHECKSUMS)
        present = {p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()}
        assert set(listed) == present - {layout.CHECKSUMS, layout.MANIFEST_JSON}
        for name, sha256 in listed.items():
            assert hashlib.sha256((root / name).read_bytes()).hexdigest() == sha256
        manifest = json.loads((root / layout.MANIFEST_JSON).read_text())
        assert manifest["half"] == half
        assert manifest["held_out"] == ["test"]
        own = hashlib.sha256((root / layout.CHECKSUMS).read_bytes()).hexdigest()
        assert manifest["checksums_sha256"] == own
        names[half] = (own, manifest["other_sha256"])
    assert names["public"] == names["private"][::-1]


def test_nothing_is_lost_between_the_halves(halves: Any) -> None:
    whole, public = Dataset.open(halves.whole), Dataset.open(halves.public)
    both = public.with_private(halves.private)
    for split in ("val", "test"):
        name = layout.queries_name(split)
        assert (halves.public / name).read_bytes() == (halves.whole / name).read_bytes()
        assert both.truth(split).equals(whole.truth(split))
    # Of the open ones, their seeds are left out.
    assert changed_files(whole, both) == {"train/sequence.json", "val/sequence.json"}


def test_without_hold_out_every_file_is_as_it_was(tiny_dataset: Path, tmp_path: Path) -> None:
    facts = publish(tiny_dataset, tmp_path / "out", PublishSettings(shard_bytes=300_000))
    assert (facts.private, facts.private_sha256, facts.warnings) == (None, None, [])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out"]
    assert changed_files(Dataset.open(tiny_dataset), Dataset.open(tmp_path / "out")) == set()
    for name in (layout.DATASET_JSON, layout.SEQUENCES_TABLE, layout.truth_name("test")):
        assert (tmp_path / "out" / name).read_bytes() == (tiny_dataset / name).read_bytes()


def test_shards_have_about_the_size_asked_for(halves: Any) -> None:
    sizes = [p.stat().st_size for p in halves.public.glob("frames/train-*.parquet")]
    assert len(sizes) >= 3
    longest = max(s.frames for s in Dataset.open(halves.public).sequences) * 90_000
    assert max(sizes) < SETTINGS.shard_bytes + longest
    index = Dataset.open(halves.public)
    for sequence in index.sequences:  # a sequence is in one shard of a kind
        places = index.files.members(sequence.id)  # type: ignore[attr-defined]
        assert len({shard for shard, _, _ in places.values()}) == 2


def test_two_publications_are_the_same_bytes(halves: Any, tmp_path: Path) -> None:
    """Another folder, another process, other times, modes, locale, time zone and hash seed."""
    copy = tmp_path / "elsewhere" / "a copy"
    shutil.copytree(halves.whole, copy, ignore=shutil.ignore_patterns(".pliant"))
    for number, path in enumerate(sorted(copy.rglob("*"), reverse=True)):
        path.chmod(0o700)
        os.utime(path, (10**9 + number, 10**9 + number))
    script = (
        "import os, sys\nos.umask(0o077)\n"
        "from pliant.cli.main import run\nsys.exit(run(sys.argv[1:]))"
    )
    out = tmp_path / "again"
    options = "--hold-out test --shard-size 300kB --answers-are-public --author Ada --author Grace"
    arguments = ["publish", copy, "--out", out, *options.split(), "--json"]
    other = {"LC_ALL": "C", "TZ": "Asia/Tokyo", "PYTHONHASHSEED": "7"}
    report = json.loads("".join(printed(script, *arguments, **other)))
    assert report["checksums_sha256"] == halves.facts.checksums_sha256
    assert report["private_sha256"] == halves.facts.private_sha256
    assert sums(out) == sums(halves.public)
    assert sums(tmp_path / "again-private") == sums(halves.private)
    assert (tmp_path / "again-private").stat().st_mode & 0o077 == 0


def test_halves_of_two_publications_do_not_fit(halves: Any, tmp_path: Path) -> None:
    publish(halves.whole, tmp_path / "out", HELD_OUT, private=tmp_path / "own")
    Dataset.open(tmp_path / "out").with_private(tmp_path / "own")
    with pytest.raises(SpecError, match="another publication"):
        Dataset.open(tmp_path / "out").with_private(halves.private)
    with pytest.raises(SpecError, match="public half"):
        Dataset.open(tmp_path / "out").with_private(tmp_path / "out")


def test_a_sheet_of_the_public_half_leaves_the_hidden_depth_blank(
    halves: Any, tmp_path: Path
) -> None:
    out = tmp_path / "sheet.png"
    assert run(["view", str(halves.public), "--out", str(out), "--count", "8"]) == 0
    with Image.open(out) as sheet:
        colours = np.asarray(sheet.convert("RGB"))
    blank = (colours == 235).all(axis=2).sum()
    assert blank > 240 * 90  # takes the place of the depth of a held-out frame


def test_calls_that_make_no_sense_are_refused(
    halves: Any, tmp_path: Path, refused: Refused
) -> None:
    whole, full, out = halves.whole, tmp_path / "full", tmp_path / "o"
    full.mkdir()
    (full / "file").write_text("x")
    for code, words, *arguments in (
        (2, "exists already", whole, "--out", full),
        (2, "inside the dataset", whole, "--out", whole / "out"),
        (2, "unknown split", whole, "--out", out, "--hold-out", "tset"),
        (2, "truth are missing", whole, "--out", out, "--hold-out", "train"),
        (2, "size cannot be read", whole, "--out", out, "--shard-size", "5XB"),
        (2, "shards would be too small", whole, "--out", out, "--shard-size", "10"),
        (2, "not an address", whole, "--out", out, "--url", "https://example.org/my ropes"),
        (2, "not an address", whole, "--out", out, "--url", "example.org/ropes"),
        (2, "date cannot be read", whole, "--out", out, "--date", "1 May"),
        (2, r"character \x0a", whole, "--out", out, "--author", "A\nB"),
        (2, "packed", halves.public, "--out", out),
        (1, "not a Pliant dataset", tmp_path, "--out", out),
    ):
        assert words in refused(code, "publish", *arguments)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["full"]


def flip_a_bit(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)


def link_away(path: Path) -> None:
    path.unlink()
    path.symlink_to("/etc/hostname")


def link_folder(path: Path) -> None:
    shutil.move(path, path.parents[4] / "elsewhere")
    path.symlink_to(path.parents[4] / "elsewhere")


REFUSED: dict[str, tuple[str, Callable[[Path], Any], str]] = {
    "a damaged image": ("rgb/000001.png", flip_a_bit, "not valid and is not published"),
    "a missing table": ("points.parquet", Path.unlink, "not valid and is not published"),
    "a link among the images": ("depth/000001.exr", link_away, r"000001\.exr.*found a link"),
    "a linked folder": ("depth", link_folder, "depth.*found a link"),
    "a linked licence": (
        "../../../LICENSE",
        lambda path: path.resolve().symlink_to("/etc/hostname"),
        "LICENSE.*found a link",
    ),
    "a pipe": ("../../../notes", lambda path: os.mkfifo(path.resolve()), "a special file"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_damaged_or_linked_dataset_is_not_published(
    name: str, halves: Any, tmp_path: Path, refused: Refused
) -> None:
    place, damage, message = REFUSED[name]
    copy = tmp_path / "copy"
    shutil.copytree(halves.whole, copy)
    damage(next(copy.glob("sequences/rope/*-test-*")) / place)
    for options in (["--hold-out", "test", "--answers-are-public"], []):
        said = refused(1, "publish", copy, "--out", tmp_path / "out", *options)
        assert re.search(message, said)
    assert {p.name for p in tmp_path.iterdir()} <= {"copy", "elsewhere"}


def test_a_guessable_seed_is_refused_unless_the_answers_are_public(
    halves: Any, tmp_path: Path, refused: Refused
) -> None:
    arguments = ("publish", halves.whole, "--out", tmp_path / "out", "--hold-out", "test")
    assert "anybody can generate the held-out answers again" in refused(2, *arguments)
    assert list(tmp_path.iterdir()) == []
    err = refused(0, *arguments, "--answers-are-public")
    assert "Warning: the held-out answers are public" in err
    # 7 figures and 3 tiers: 100 * 10 * log2(9,000) / log2(160 * 120) = 923.2
    assert "100 submissions of 10 figures reveal up to 923 positions" in err
    assert "12 image pairs" in err
    assert run(["publish", str(halves.whole), "--out", str(tmp_path / "open")]) == 0


def test_the_papers(halves: Any) -> None:
    citation = yaml.safe_load((halves.public / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert [author["name"] for author in citation["authors"]] == ["Ada", "Grace"]
    assert citation["license"] == "CC-BY-4.0"
    assert "CC-BY-4.0" in (halves.public / "LICENSE").read_text()
    card = (halves.public / "README.md").read_text()
    front = yaml.safe_load(card.split("---\n")[1])
    assert front["license"] == "cc-by-4.0"
    default = [config["config_name"] for config in front["configs"] if config.get("default")]
    assert default == ["queries"]
    for config in front["configs"]:
        for part in config["data_files"]:
            assert list(halves.public.glob(part["path"])), part
    assert "| cloth-3 | 2, 4 | 1, 2 | 2, 4 | 289 |" in card
    assert "288 queries in 12 image pairs, answers held out" in card
    assert "means over the splits whose answers are public." in " ".join(card.split())
    for name in ("overview.jpg", "test.jpg"):
        assert f"pictures/{name}" in card
        with Image.open(halves.public / "pictures" / name) as picture:
            assert np.asarray(picture).std() > 20


def test_free_texts_of_the_card_are_no_markdown(halves: Any, tmp_path: Path) -> None:
    root = tmp_path / "copy"
    shutil.copytree(halves.public, root, ignore=shutil.ignore_patterns("pictures"))
    info = json.loads((root / "dataset.json").read_text())
    changed = {"title": "*Ropes* & <b>knots</b>", "description": "# [Ropes](x) ~~1~~"}
    (root / "dataset.json").write_text(json.dumps(info | changed))
    write_card(Dataset.open(root), root, authors=["Ada_L_ <img src=x>", "`G`"], url=None)
    card = (root / "README.md").read_text().split("---\n", 2)[2]
    page = MarkdownIt("gfm-like", {"linkify": False}).render(card)
    for text in ("*Ropes* & <b>knots</b>", "# [Ropes](x) ~~1~~", "Ada_L_ <img src=x>, `G`"):
        assert html.escape(text) in " ".join(page.split())


@pytest.mark.parametrize(
    ("url", "page"),
    [
        ("hf://datasets/ada/tiny", "https://huggingface.co/datasets/ada/tiny"),
        ("https://example.org/tiny", "https://example.org/tiny"),
        ("s3://ada/tiny", None),
    ],
)
def test_papers_name_the_page_that_a_browser_opens(url: str, page: str | None, halves: Any) -> None:
    """The schema of CITATION.cff 1.2.0 allows http, https, ftp and sftp alone."""
    info = Dataset.open(halves.public).info
    assert yaml.safe_load(citation(info, ["Ada"], url, None)).get("url") == page
    pages = [
        each["identifier"] for each in zenodo(info, [], url, None).get("related_identifiers", [])
    ]
    assert pages == ([] if page is None else [page])


def test_a_name_with_a_hyphen_stays_on_its_line() -> None:
    """Markdown shows the end of a line as a space."""
    template = environment("pliant.publishing").from_string("{{ text|fill }}")
    text = template.render(text="a " * 40 + "Grace Brewster-Murray-Hopper")
    assert "Brewster-Murray-Hopper" in text


def test_croissant_is_accepted_offline(halves: Any) -> None:
    pytest.importorskip("mlcroissant")
    path = halves.public / "croissant.json"
    code = (
        "import sys, mlcroissant as mlc\n"
        "dataset = mlc.Dataset(jsonld=sys.argv[1])\n"
        "print(dataset.metadata.ctx.conforms_to.value)\n"
        "rows = list(dataset.records('queries_test'))\n"
        "print(len(rows), rows[0]['queries_test/sequence_a'].decode())\n"
        "answers = list(mlc.Dataset(jsonld=sys.argv[1]).records('truth_val'))\n"
        "print(len(answers), len(answers[-1]['truth_val/alternatives']))\n"
    )
    public = Dataset.open(halves.public)
    truth = public.truth("val")
    assert printed(code, path)[-3:] == [
        "http://mlcommons.org/croissant/1.1",
        f"288 {public.queries('test')['sequence_a'][0].as_py()}",
        f"{len(truth)} {len(truth['alternatives'][-1])}",
    ]


def test_croissant_is_complete_and_true_to_the_files(halves: Any) -> None:
    assert list(croissant_problems(halves.public)) == []
