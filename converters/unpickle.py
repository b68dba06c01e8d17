"""Reads pickles of arrays without executing anything.

A pickle is a program. Its machine can only call what it finds by name, so a name is looked up
in a table of stand-ins of our own and nowhere else: numpy's own rebuilding functions, which
trust what they are given, are never called either. What the stand-ins have noted is turned into
arrays afterwards, with every size checked.

A few bytes can also ask for unbounded work: lists of references to one list expand without end, a
tuple of such tuples as a key is hashed without end, the C machine allocates what an index or a
length announces. So Python's own machine runs here, only numbers and text are keys, and the values
and bytes that come out are bounded by the size of the file.
"""

from __future__ import annotations

import pickle
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, ClassVar, Final

import numpy as np

from pliant.spec.errors import SpecError

MAX_FILE_BYTES: Final = 64 * 2**30
_PLAIN: Final = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248])")
_DEPTH: Final = 32
_BYTES_PER_FILE_BYTE: Final = 4
"""Bytes that text and arrays may take together, per byte of the file."""


def read_pickle(path: Path) -> Any:
    """Return what a pickle contains: dicts, lists, text, bytes, numbers and numeric arrays.

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
            reader = _Reader(stream, size)
            return reader.finished(reader.load(), 0)
    except _RefusedError as error:
        raise SpecError(
            "the pickle asks for something that is not plain data, and was not run",
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
    """The pickle asks for a name that is not in the table, or for an array that is not an array."""


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


def _put(target: Any, key: Any, value: Any) -> None:
    """Put an item into a dict; tuples, and numbers of many digits, take too long to hash."""
    number = isinstance(key, int) and -(2**63) <= key < 2**63
    if not isinstance(target, dict) or not (number or isinstance(key, str | bytes | float)):
        raise _RefusedError(f"an item with a {type(key).__name__} as its key")
    target[key] = value


def _dict(pairs: Any = ()) -> dict[Any, Any]:
    """Stand for `collections.OrderedDict`."""
    made: dict[Any, Any] = {}
    for key, value in pairs:
        _put(made, key, value)
    return made


def _no_bytes() -> bytes:
    """Stand for `bytes()`, as which old protocols store none."""
    return b""


_ALLOWED: Final[dict[tuple[str, str], Any]] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    ("collections", "OrderedDict"): _dict,
    ("builtins", "bytes"): _no_bytes,
    ("__builtin__", "bytes"): _no_bytes,
}
for _core in ("numpy.core", "numpy._core"):
    _ALLOWED[f"{_core}.multiarray", "_reconstruct"] = _reconstruct
    _ALLOWED[f"{_core}.multiarray", "scalar"] = _Scalar
    _ALLOWED[f"{_core}.numeric", "_frombuffer"] = _Buffer


class _Stream:
    """A file that is never asked for more bytes than it has left."""

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self._stream, self._size = stream, size
        self.readline = stream.readline

    def read(self, count: int) -> bytes:
        if count > self._size - self._stream.tell():
            raise EOFError("the file ends before its data")
        return self._stream.read(count)


class _Reader(pickle._Unpickler):
    """An unpickler that finds nothing but the stand-ins, and does no unbounded work."""

    stack: list[Any]
    read: Callable[[int], bytes]
    append: Callable[[Any], None]
    pop_mark: Callable[[], list[Any]]
    dispatch: ClassVar[dict[int, Callable[[Any], None]]] = {**pickle._Unpickler.dispatch}

    def __init__(self, stream: IO[bytes], size: int) -> None:
        super().__init__(_Stream(stream, size), encoding="latin1")
        self._values_left = max(size, 64)  # a value takes a byte of the file, or it is shared
        self._bytes_left = _BYTES_PER_FILE_BYTE * size
        self._resolved: dict[int, Any] = {}

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("_codecs", "encode"):
            return self._encode
        if (module, name) not in _ALLOWED:
            raise _RefusedError(f"{module}.{name}"[:120])
        return _ALLOWED[module, name]

    def persistent_load(self, pid: Any) -> Any:
        raise _RefusedError("an object kept outside the file")

    def load_build(self) -> None:
        """Give a stand-in its state; nothing else takes one."""
        state = self.stack.pop()
        if not isinstance(self.stack[-1], _Dtype | _Array):
            raise _RefusedError("a state for something that takes none")
        self.stack[-1].__setstate__(state)

    def load_bytearray8(self) -> None:
        """Read the bytes before memory for them is taken."""
        (count,) = struct.unpack("<Q", self.read(8))
        self.append(bytearray(self.read(count)))

    def load_setitem(self) -> None:
        """Put one item into a dict."""
        value, key = self.stack.pop(), self.stack.pop()
        _put(self.stack[-1], key, value)

    def load_setitems(self) -> None:
        """Put items into a dict."""
        items = self.pop_mark()
        for key, value in zip(items[::2], items[1::2], strict=True):
            _put(self.stack[-1], key, value)

    def load_dict(self) -> None:
        """Make a dict of items."""
        items = self.pop_mark()
        self.append(_dict(list(zip(items[::2], items[1::2], strict=True))))

    def _refuse_opcode(self) -> None:
        raise _RefusedError("a set or an object")

    for _opcode, _load in (
        (pickle.BUILD, load_build),
        (pickle.BYTEARRAY8, load_bytearray8),
        (pickle.SETITEM, load_setitem),
        (pickle.SETITEMS, load_setitems),
        (pickle.DICT, load_dict),
        (pickle.EMPTY_SET, _refuse_opcode),
        (pickle.ADDITEMS, _refuse_opcode),
        (pickle.FROZENSET, _refuse_opcode),
        (pickle.EXT1, _refuse_opcode),
        (pickle.EXT2, _refuse_opcode),
        (pickle.EXT4, _refuse_opcode),
    ):
        dispatch[_opcode[0]] = _load

    def _encode(self, text: object, encoding: object = "") -> bytes:
        """Stand for `_codecs.encode`, as which old protocols store bytes."""
        if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
            raise _RefusedError(f"_codecs.encode to {encoding!r:.40}")
        self._take_bytes(len(text))
        return text.encode("latin-1")

    def _take_bytes(self, count: int) -> None:
        self._bytes_left -= count
        if self._bytes_left < 0:
            raise _RefusedError("more data than the file has: one value repeated")

    def finished(self, value: Any, depth: int) -> Any:
        """Return a value with its stand-ins turned into arrays."""
        self._values_left -= 1
        if self._values_left < 0:
            raise _RefusedError("more values than the file has: one list or dict repeated")
        if depth > _DEPTH:
            raise _RefusedError("data nested too deeply")
        if isinstance(value, _Array | _Buffer):
            if id(value) not in self._resolved:
                array = value.resolve()
                self._take_bytes(array.nbytes)
                self._resolved[id(value)] = array
            return self._resolved[id(value)]
        if isinstance(value, dict):
            return {key: self.finished(v, depth + 1) for key, v in value.items()}
        if isinstance(value, list | tuple):
            return [self.finished(item, depth + 1) for item in value]
        if value is None or isinstance(value, str | bytes | int | float):
            return value
        raise _RefusedError(f"a {type(value).__name__}")


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
