"""The commands that are disturbed: their inputs, the state before, and what must hold after."""

from __future__ import annotations

import hashlib
import shutil
import tarfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from tests.faults.inputs import create, once, pliant, publish
from tests.faults.trainings import DON, TIMECYCLE, training

_PICTURE: Final = "data/sequences/rope/rope-test-000000/rgb/00000"
_RECORDS: Final = (".pliant", "tensorboard")
"""Folders of logs, whose content differs from run to run."""


def digests(work: Path) -> dict[str, str]:
    """Return file -> sha256 of everything in a folder but logs."""
    return {
        path.relative_to(work).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(work.rglob("*"))
        if path.is_file() and not set(path.parts) & set(_RECORDS)
    }


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        prepare: Fills its folder before each run, from a folder of inputs.
        action: Does it in that folder and returns an exit code.
        again: Does it again after an interruption; None is `action`.
        state: What is compared of the folder.
        inputs: Whether it reads any.
        continues: A run that was interrupted is continued: it may leave more than it found.
    """

    prepare: Callable[[Path, Path], None]
    action: Callable[[Path, Path], int]
    again: Callable[[Path, Path], int] | None = None
    state: Callable[[Path], dict[str, Any]] = digests
    inputs: bool = True
    continues: bool = False


def _nothing(inputs: Path, work: Path) -> None:
    """Leave the folder empty."""


def _earlier(*names: str) -> Callable[[Path, Path], None]:
    """Return what puts results of an earlier call into the folder, from inputs."""

    def prepare(inputs: Path, work: Path) -> None:
        for name in names:
            source, _, target = name.partition(":")
            place = work / (target or source)
            copy = shutil.copytree if (inputs / source).is_dir() else shutil.copyfile
            copy(inputs / source, place)

    return prepare


def _call(*arguments: str) -> Callable[[Path, Path], int]:
    """Return a call of the command line; `IN/` and `OUT/` begin paths."""

    def action(inputs: Path, work: Path) -> int:
        folders = {"IN": str(inputs), "OUT": str(work)}
        return pliant(
            *("/".join([folders.get(head, head), *rest]) if rest else head
              for head, *rest in (each.split("/") for each in arguments))
        )  # fmt: skip

    return action


def _generate(sequences: int, style: str = "raster", stand_in: bool = True) -> Any:
    """Return a generation of rope sequences, by default by the stand-in in this process."""

    def action(inputs: Path, work: Path) -> int:
        if stand_in:
            from pliant.generator.runner import run as runner
            from tests.generator.runner.standin import InProcess, maker

            runner.sequence_maker = lambda config, root, threads=1: maker(config, root)
            runner._open_engine = lambda *_: InProcess()
        size = "48x32" if stand_in else "64x64"
        return pliant("generate", "rope", "--sequences", sequences, "--frames", 2, "--size", size,
                      "--style", style, "--workers", 1, "--out", work / "set")  # fmt: skip

    return action


def _generated(inputs: Path, work: Path) -> None:
    """Put a finished set of two sequences into the folder."""
    once(inputs / "grown", lambda made: _generate(2)(inputs, made))
    shutil.copytree(inputs / "grown", work, dirs_exist_ok=True)


def _episodes(inputs: Path, work: Path) -> None:
    """Add a set of three episodes of six frames to the inputs."""
    size = ("--frames", 6, "--size", "64x64", "--style", "raster", "--workers", 1)
    call = ("generate", "rope", "--episodes", "--sequences", 3, *size)
    once(inputs / "episodes", lambda made: pliant(*call, "--out", made))


def _evaluate(inputs: Path, work: Path) -> int:
    """Evaluate; the submission is read here: the process that reads it writes nothing."""
    from pliant.evaluator.submission import loading

    vars(loading)["run_limited"] = lambda read, **_: read()
    file, data = inputs / "identity.parquet", inputs / "data"
    return pliant("evaluate", file, "--data", data, "--out", work / "report")


def _recordings(work: Path) -> dict[str, Any]:
    """Return tens of kilobytes of recordings: Rerun's files have times in them."""
    found: dict[str, Any] = digests(work)
    sizes = {name: (work / name).stat().st_size for name in found if name.endswith(".rrd")}
    return {**found, **{name: size // 10_000 for name, size in sizes.items()}}


def _archived(work: Path) -> dict[str, Any]:
    """Return sizes of the files of an archive, which has times in it."""
    found: dict[str, Any] = digests(work)
    for name in [name for name in found if name.endswith(".tar") and not name.startswith(".")]:
        with tarfile.open(work / name) as tar:
            found[name] = sorted((each.name, each.size) for each in tar)
    return found


def _books(work: Path) -> dict[str, Any]:
    """Return what challenges contain, and digests of the other files."""
    from tests.faults.challenges import books

    found = digests(work)
    for path in work.iterdir():
        if not path.name.startswith(".") and (path / "challenge.yaml").is_file():
            for name in [name for name in found if name.startswith(f"{path.name}/")]:
                if "/keys/" in name or "/challenge.sqlite" in name:
                    del found[name]
            found[f"{path.name}/books"] = books(path)
    return found


def _credit(inputs: Path, work: Path) -> int:
    return pliant("challenge", "credit", work / "challenge", "Later", 3)


def _credit_once(inputs: Path, work: Path) -> int:
    """Give the credit unless the challenge has it already, as its host does."""
    from tests.faults.challenges import credits_of

    return 0 if credits_of(work / "challenge") else _credit(inputs, work)


def _score(inputs: Path, work: Path) -> int:
    from tests.faults.challenges import work as score_what_waits

    return score_what_waits(work / "challenge")


COMMANDS: Final[dict[str, Command]] = {
    "generate": Command(_nothing, _generate(3), inputs=False, continues=True),
    "generate-grow": Command(_generated, _generate(3), inputs=False, continues=True),
    "generate-blender": Command(
        _nothing, _generate(1, "fast", stand_in=False), inputs=False, continues=True
    ),
    "predict": Command(
        _earlier("centroid.parquet:out.parquet"),
        _call("predict", "identity", "--data", "IN/data", "--out", "OUT/out.parquet"),
    ),
    "evaluate": Command(
        _earlier("centroid:report"),
        _evaluate,
    ),
    "leaderboard": Command(
        _nothing, _call("leaderboard", "IN/identity", "IN/centroid", "--out", "OUT/table.html")
    ),
    "site": Command(_nothing, _call("leaderboard", "IN/identity", "IN/centroid", "--out", "OUT/s")),
    "view": Command(_nothing, _call("view", "IN/data", "--out", "OUT/sheet.png", "--count", "2")),
    "match": Command(
        _nothing,
        _call("match", "identity", "--source", f"IN/{_PICTURE}0.png",
              "--target", f"IN/{_PICTURE}1.png", "--at", "30,30", "--out", "OUT/figure.png"),
    ),
    "import": Command(
        _nothing, _call("import", "IN/coco/annotations.json", "--out", "OUT/set")
    ),
    "publish": Command(_nothing, publish),
    **{
        f"convert-{target}": Command(
            _nothing,
            _call("convert", "IN/data", "--to", target, "--out", "OUT/set"),
            state=_recordings if target == "rerun" else digests,
        )
        for target in ("rerun", "lerobot", "coco", "tapvid", "webdataset", "glb")
    },
    "train": Command(_nothing, *training("don", "data", DON), continues=True),
    "train-timecycle": Command(
        _episodes, *training("timecycle", "episodes", TIMECYCLE), continues=True
    ),
    "challenge-create": Command(_nothing, create, state=_books),
    "challenge-invite": Command(
        _earlier("challenge"), _call("challenge", "invite", "OUT/challenge", "Team"), state=_books
    ),
    "challenge-credit": Command(_earlier("challenge"), _credit, _credit_once, state=_books),
    "challenge-work": Command(
        _earlier("waiting:challenge"), _score, state=_books, continues=True
    ),
    "challenge-backup": Command(
        _earlier("backup"), _call("challenge", "backup", "IN/challenge", "--out", "OUT/backup")
    ),
    "challenge-archive": Command(
        _nothing,
        _call("challenge", "archive", "IN/challenge", "--out", "OUT/archive.tar"),
        state=_archived,
    ),
    **{
        f"challenge-restore{ending}": Command(
            _nothing,
            _call("challenge", "restore", f"IN/{source}", "--out", "OUT/challenge"),
            state=_books,
        )
        for ending, source in (("", "archive.tar"), ("-backup", "backup"))
    },
}  # fmt: skip
