"""Recognises files that are often given in place of a Parquet file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

ADVICE: Final = (
    "Submissions are Parquet files with a footer. A table of answers (CSV, JSON lines, Parquet) "
    "becomes one by: pliant submission ANSWERS --data DATA --out SUB.parquet"
)
_STARTS: Final = {
    b"PK\x03\x04": "a zip archive (or npz, xlsx)",
    b"\x1f\x8b": "a gzip archive",
    b"\x93NUMPY": "a NumPy .npy file",
    b"\x89HDF": "an HDF5 file",
    b"ARROW1": "an Arrow (Feather) file",
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"\x80\x04\x95": "a Python pickle",
}


def kind_of_file(path: Path) -> str | None:
    """Return a sentence that says what a file is, if it is another kind that we recognise.

    Args:
        path: A regular file.
    """
    try:
        with open(path, "rb") as stream:
            start = stream.read(4096)
    except OSError:
        return None
    if not start:
        return f"the file is empty. {ADVICE}"
    for magic, kind in _STARTS.items():
        if start.startswith(magic):
            return f"this is {kind}. {ADVICE}"
    try:
        text = start.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if error.reason != "unexpected end of data":
            return None
        text = start[: error.start].decode("utf-8-sig")
    if not text.isprintable() and not re.fullmatch(r"[^\x00-\x08\x0e-\x1f\x7f]*", text):
        return None
    if text.lstrip().startswith(("{", "[")):
        return f"this is a JSON file. {ADVICE}"
    line = next(iter(text.splitlines()), "")
    if line.count(",") or line.count(";") or line.count("\t"):
        return f"this is a CSV file. {ADVICE}"
    return f"this is a text file. {ADVICE}"
