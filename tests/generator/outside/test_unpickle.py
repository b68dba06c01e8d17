"""Pickles are read as data: what is plain comes out as it went in, what is not is never run."""

from __future__ import annotations

import os
import pickle
import pickletools
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.generator.outside.unpickle import read_pickle
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
    with pytest.raises(SpecError, match="no plain data"):
        read_pickle(path)


def test_an_array_over_too_few_bytes_is_refused(tmp_path: Path) -> None:
    """numpy's own `__setstate__` is never given the bytes, so nothing can be read beyond them."""
    data = pickle.dumps(np.arange(7, dtype=np.uint8), 2)
    sevens = [at for op, arg, at in pickletools.genops(data) if op.name == "BININT1" and arg == 7]
    assert len(sevens) == 1
    path = tmp_path / "data.pkl"
    path.write_bytes(data[: sevens[0] + 1] + b"\xff" + data[sevens[0] + 2 :])
    with pytest.raises(SpecError, match=r"an array of shape \(255,\) over 7 bytes"):
        read_pickle(path)


def test_every_cut_of_a_pickle_is_refused_in_one_sentence(tmp_path: Path) -> None:
    data = pickle.dumps({"points": np.arange(3.0), "name": "x"}, 4)
    path = tmp_path / "cut.pkl"
    for length in range(len(data)):
        path.write_bytes(data[:length])
        with pytest.raises(SpecError, match=r"cannot be read|no plain data"):
            read_pickle(path)
