"""Reads pickles of arrays without executing anything.

A pickle is a program. Its machine can only call what it finds by name, so a name is looked up
in a table of stand-ins of our own and nowhere else: numpy's own rebuilding functions, which
trust what they are given, are never called either. What the stand-ins have noted is turned into
arrays afterwards, with every size checked.
"""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from pliant.spec.errors import SpecError

MAX_FILE_BYTES: Final = 64 * 2**30
_PLAIN: Final = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248])")
_DEPTH: Final = 32


def read_pickle(path: Path) -> Any:
    """Return what a pickle holds: dicts, lists, text, bytes, numbers and numeric arrays.

    Args:
        path: The file. Pickles of numpy 1 and 2, protocols 0 to 5, are read.

    Raises:
        SpecError: It asks for anything else, or is damaged. Nothing of it was run.
    """
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise SpecError(
            "the file is too large", path=path, found=size, required=f"at most {MAX_FILE_BYTES}"
        )
    try:
        with path.open("rb") as stream:
            return _finished(_Reader(stream).load(), 0)
    except _RefusedError as error:
        raise SpecError(
            "the pickle asks for something that is no plain data, and was not run",
            path=path,
            found=str(error),
            required="dicts, lists, text, bytes, numbers and numeric numpy arrays",
            fix="Save the arrays with numpy.savez instead, if you trust the file",
        ) from None
    except Exception as error:  # a damaged pickle fails in as many ways as there are opcodes
        raise SpecError(
            "the pickle cannot be read", path=path, found=f"{type(error).__name__}: {error}"[:200]
        ) from error


class _RefusedError(Exception):
    """The pickle asks for a name that is not in the table, or for an array that is no array."""


class _Dtype:
    """Stands for `numpy.dtype`: keeps its text and its byte order."""

    def __init__(self, text: object = "", *_: object) -> None:
        self.text = text if isinstance(text, str) else ""
        self.order = "|"

    def __setstate__(self, state: Any) -> None:
        self.order = state[1]

    def resolve(self) -> np.dtype[Any]:
        if _PLAIN.fullmatch(self.text) is None or self.order not in ("<", ">", "|", "="):
            raise _RefusedError(f"an array of dtype {self.text[:40]!r}")
        return np.dtype(self.order + self.text.lstrip("<>|="))


class _Array:
    """Stands for `numpy.ndarray`: keeps the state that numpy would take."""

    def __init__(self) -> None:
        self.state: Any = None

    def __setstate__(self, state: Any) -> None:
        self.state = state

    def resolve(self) -> np.ndarray[Any, Any]:
        _, shape, dtype, fortran, data = self.state
        return _array(data, dtype, shape, "F" if fortran else "C")


class _Buffer:
    """Stands for the call of `numpy._frombuffer`, which protocol 5 uses."""

    def __init__(self, *arguments: Any) -> None:
        self.arguments = arguments

    def resolve(self) -> np.ndarray[Any, Any]:
        return _array(*self.arguments)


class _Scalar(_Buffer):
    """Stands for the call of `numpy.scalar`."""

    def resolve(self) -> Any:
        dtype, data = self.arguments
        return _array(data, dtype, (), "C")[()]


def _reconstruct(*_: object) -> _Array:
    return _Array()


def _encode(text: object, encoding: object = "") -> bytes:
    """Stand for `_codecs.encode`, as which old protocols store bytes."""
    if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
        raise _RefusedError(f"_codecs.encode to {encoding!r:.40}")
    return text.encode("latin-1")


def _no_bytes() -> bytes:
    """Stand for `bytes()`, as which old protocols store none."""
    return b""


_ALLOWED: Final[dict[tuple[str, str], Any]] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    ("_codecs", "encode"): _encode,
    ("collections", "OrderedDict"): dict,
    ("builtins", "bytes"): _no_bytes,
    ("__builtin__", "bytes"): _no_bytes,
}
for _core in ("numpy.core", "numpy._core"):
    _ALLOWED[f"{_core}.multiarray", "_reconstruct"] = _reconstruct
    _ALLOWED[f"{_core}.multiarray", "scalar"] = _Scalar
    _ALLOWED[f"{_core}.numeric", "_frombuffer"] = _Buffer


class _Reader(pickle.Unpickler):
    """An unpickler that finds nothing but the stand-ins."""

    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__(stream, encoding="latin1")

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _ALLOWED:
            raise _RefusedError(f"{module}.{name}"[:120])
        return _ALLOWED[module, name]

    def persistent_load(self, pid: Any) -> Any:
        raise _RefusedError("an object kept outside the file")


def _array(data: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray[Any, Any]:
    """Return an array over bytes, after checking that they are as many as it needs."""
    if not isinstance(dtype, _Dtype) or not isinstance(data, bytes | bytearray | str):
        raise _RefusedError("an array that does not hold its own numbers")
    kind = dtype.resolve()
    raw = data.encode("latin-1") if isinstance(data, str) else bytes(data)
    shape = tuple(int(side) for side in shape)
    count = 1
    for side in shape:
        count *= side
    if min(shape, default=0) < 0 or count * kind.itemsize != len(raw):
        raise _RefusedError(f"an array of shape {shape} over {len(raw)} bytes")
    return np.frombuffer(raw, kind).reshape(shape, order="F" if order == "F" else "C")


def _finished(value: Any, depth: int) -> Any:
    """Return a value with its stand-ins turned into arrays."""
    if depth > _DEPTH:
        raise _RefusedError("data nested too deeply")
    if isinstance(value, _Array | _Buffer):
        return value.resolve()
    if isinstance(value, dict):
        return {_finished(k, depth + 1): _finished(v, depth + 1) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finished(item, depth + 1) for item in value]
    if value is None or isinstance(value, str | bytes | int | float):
        return value
    raise _RefusedError(f"a {type(value).__name__}")
