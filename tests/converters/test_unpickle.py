"""Pickles are read as data: what is plain comes out as it went in, what is not is never run."""

from __future__ import annotations

import os
import pickle
import pickletools
import struct
import subprocess
import sys
import tracemalloc
import zlib
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.converters.tapvid import read_tapvid
from pliant.converters.unpickle import read_pickle
from pliant.spec.errors import SpecError

RNG = np.random.default_rng(0)
PLAIN: dict[str, Any] = {
    "u1": RNG.integers(0, 256, (3, 4, 5, 3)).astype(np.uint8),
    "f4": RNG.random((2, 3, 2), np.float32),
    "fortran": np.asfortranarray(RNG.random((3, 4))),
    "big-endian": RNG.random(5).astype(">f8"),
    "bool": np.array([[True, False], [False, True]]),
    "no rows": np.zeros((0, 2), np.float32),
    "strided": np.arange(20)[::2],
}


@pytest.mark.parametrize("protocol", range(6))
def test_plain_data_comes_out_as_it_went_in(protocol: int, tmp_path: Path) -> None:
    path = tmp_path / "data.pkl"
    value = OrderedDict(PLAIN, names=["a", "b"], data=b"\x00\xff\xd8", number=3, nothing=None)
    value["scalar"] = np.float32(1.5)
    path.write_bytes(pickle.dumps(value, protocol))
    found = read_pickle(path)
    assert list(found) == list(value)
    for name, array in PLAIN.items():
        assert found[name].dtype == array.dtype, name
        np.testing.assert_array_equal(found[name], array)
    assert found["names"] == ["a", "b"]
    assert found["data"] == b"\x00\xff\xd8"
    assert (found["number"], found["nothing"], found["scalar"]) == (3, None, 1.5)


@pytest.mark.parametrize("protocol", [0, 2])
def test_arrays_of_numpy_2_are_read(protocol: int, tmp_path: Path) -> None:
    """numpy 2 calls its rebuilding functions by another name."""
    array = np.arange(6, dtype=np.float32).reshape(2, 3)
    data = pickle.dumps(array, protocol)
    path = tmp_path / "data.pkl"
    for own, other in ((b"numpy._core.", b"numpy.core."), (b"numpy.core.", b"numpy._core.")):
        data = data.replace(own, other)
    assert b"numpy._core.multiarray" in data
    path.write_bytes(data)
    np.testing.assert_array_equal(read_pickle(path), array)


class Run:
    """Reduces to a call."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self.call = (function, arguments)

    def __reduce__(self) -> Any:
        return self.call


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_a_malicious_pickle_does_not_run(protocol: int, tmp_path: Path) -> None:
    """The same bytes do run in an ordinary unpickler, so the test would see it."""
    witness = tmp_path / "witness"
    path = tmp_path / "evil.pkl"
    path.write_bytes(pickle.dumps({"video": Run(os.mkdir, str(witness))}, protocol))
    with pytest.raises(SpecError, match="was not run") as caught:
        read_pickle(path)
    assert not witness.exists()
    assert str(caught.value).count("\n") == 0
    assert "found posix.mkdir" in str(caught.value)
    pickle.loads(path.read_bytes())
    assert witness.exists()


@pytest.mark.parametrize(
    "value",
    [
        Run(eval, "1 + 1"),
        Run(getattr, "text", "upper"),
        Run(np.load, "x.npy"),
        Run(bytearray, 8),
        np.array([b"x", None], dtype=object),
        np.zeros(2, [("a", "f4"), ("b", "i4")]),
        {1, 2},
        len,
    ],
    ids=["eval", "getattr", "numpy.load", "bytearray", "objects", "records", "set", "function"],
)
def test_what_is_no_plain_data_is_refused(value: Any, tmp_path: Path) -> None:
    path = tmp_path / "data.pkl"
    path.write_bytes(pickle.dumps([value], 4))
    with pytest.raises(SpecError, match="not plain data"):
        read_pickle(path)


def test_an_array_over_too_few_bytes_is_refused(tmp_path: Path) -> None:
    """numpy's own `__setstate__` is never given the bytes, so nothing can be read beyond them."""
    data = pickle.dumps(np.arange(7, dtype=np.uint8), 2)
    sevens = [at for op, arg, at in pickletools.genops(data) if op.name == "BININT1" and arg == 7]
    assert len(sevens) == 1
    (at,) = sevens
    assert at is not None
    path = tmp_path / "data.pkl"
    path.write_bytes(data[: at + 1] + b"\xff" + data[at + 2 :])
    with pytest.raises(SpecError, match=r"an array of shape \(255,\) over 7 bytes"):
        read_pickle(path)


def test_every_cut_of_a_pickle_is_refused_in_one_sentence(tmp_path: Path) -> None:
    data = pickle.dumps({"points": np.arange(3.0), "name": "x"}, 4)
    path = tmp_path / "cut.pkl"
    for length in range(len(data)):
        path.write_bytes(data[:length])
        with pytest.raises(SpecError, match=r"cannot be read|not plain data"):
            read_pickle(path)


def _put_index(index: int) -> bytes:
    return b"\x80\x04]r" + struct.pack("<I", index) + b"."


def _nested(make: bytes, levels: int) -> bytes:
    """Return a pickle of a list (or tuple) of two references to a list of two references …"""
    data = b"\x80\x04K\x01"
    for level in range(levels):
        put = b"q" + bytes([level])
        data += put + b"0(" + b"h" + bytes([level]) + b"h" + bytes([level]) + make
    return data


_LISTS, _TUPLES = _nested(b"l", 30), _nested(b"t", 40)
_BIG = b"X" + struct.pack("<I", 100_000) + b"a" * 100_000
HOSTILE = {
    "shared lists": _LISTS + b".",
    "shared dicts": b"\x80\x04}" + b"".join(
        b"q" + bytes([k]) + b"0(K\x01h" + bytes([k]) + b"K\x02h" + bytes([k]) + b"d"
        for k in range(30)
    ) + b".",
    "tuple as a key": _TUPLES + b"q\xff0}h\xffK\x01s.",
    "tuple as a key of a dict of items": _TUPLES + b"q\xff0(h\xffK\x01d.",
    "tuple in a set": _TUPLES + b"q\xff0\x8f(h\xff\x90.",
    "tuple in a frozen set": _TUPLES + b"q\xff0(h\xff\x91.",
    "tuple as a key of OrderedDict": _TUPLES
    + b"q\xff0ccollections\nOrderedDict\n((h\xffK\x01tt\x85R.",
    "an announced bytearray": b"\x80\x05\x96" + struct.pack("<Q", 2**36) + b"abc.",
    "announced bytes": b"\x80\x05\x8e" + struct.pack("<Q", 2**36) + b"abc.",
    "an announced frame": b"\x80\x04\x95" + struct.pack("<Q", 2**36) + b"N.",
    "text encoded again and again": b"\x80\x02" + _BIG + b"q\x000X\x06\x00\x00\x00latin1q\x010"
    b"c_codecs\nencode\nq\x020(" + b"h\x02h\x00h\x01\x86R" * 20_000 + b"l.",
    "a state for a function": b"\x80\x02c_codecs\nencode\n}X\x01\x00\x00\x00aK\x01sb.",
    "a state for a class": b"\x80\x02cnumpy\ndtype\nN}X\x07\x00\x00\x00resolveK\x01s\x86b.",
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_few_bytes_cannot_ask_for_much(name: str, tmp_path: Path) -> None:
    """In a process of its own, with 1 GiB of memory and 10 s of time."""
    path = tmp_path / "evil.pkl"
    path.write_bytes(HOSTILE[name])
    script = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "from pliant.converters.unpickle import read_pickle\n"
        "from pliant.spec.errors import SpecError\n"
        "resource.setrlimit(resource.RLIMIT_CPU, (10, 10))\n"
        "resource.setrlimit(resource.RLIMIT_AS, (2**31, 2**31))\n"
        "try:\n    read_pickle(Path(sys.argv[1]))\n"
        "except SpecError as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr[-500:]
    assert "not plain data" in done.stdout or "ends before its data" in done.stdout
    assert "MemoryError" not in done.stdout


def test_a_large_memo_index_takes_no_memory(tmp_path: Path) -> None:
    """The C machine allocates a table of twice as many entries as the index says."""
    path = tmp_path / "data.pkl"
    path.write_bytes(_put_index(2**31 - 1))
    assert read_pickle(path) == []


def test_what_is_shared_within_reason_is_read(tmp_path: Path) -> None:
    size, array = [256, 256], np.arange(1000.0)
    path = tmp_path / "data.pkl"
    path.write_bytes(pickle.dumps({f"clip-{k}": {"size": size, "a": array} for k in range(9)}))
    found = read_pickle(path)
    assert found["clip-8"]["size"] == size
    assert found["clip-8"]["a"] is found["clip-0"]["a"]


def _large_png(side: int) -> bytes:
    """Return a PNG of side x side black pixels; its rows are compressed without being made."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    squeeze, row = zlib.compressobj(9), b"\0" * (1 + side)
    pixels = b"".join(squeeze.compress(row) for _ in range(side)) + squeeze.flush()
    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        chunk(*each) for each in ((b"IHDR", header), (b"IDAT", pixels), (b"IEND", b""))
    )


def test_a_large_picture_in_a_pickle_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    record = {
        "video": [_large_png(8193)],
        "points": np.zeros((1, 1, 2)),
        "occluded": np.zeros((1, 1), bool),
    }
    path = tmp_path / "clip.pkl"
    path.write_bytes(pickle.dumps(record))
    tracemalloc.start()
    with pytest.raises(SpecError, match="8193x8193 px; at most 8192"):
        read_tapvid(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16 * 2**20


def test_an_npz_that_unpacks_to_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pliant.converters.tapvid._MAX_NPZ_BYTES", 10_000)
    np.savez_compressed(tmp_path / "a.npz", video=np.zeros((1, 100, 100, 3), np.uint8))
    with pytest.raises(SpecError, match="bytes once unpacked; at most 10,000"):
        read_tapvid(tmp_path / "a.npz")
