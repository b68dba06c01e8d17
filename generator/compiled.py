"""Functions compiled by Numba, and the folder where their machine code is kept.

Numba's own cache notices an edit in the file of a function, not one in a module that the function
takes a callee or a constant from: it would run the old result. So every module with compiled
functions has a cache folder of its own, named by a digest of its source and of the sources of
all modules of its package that it imports, directly or through others. An edit in any of them
gives another folder.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar, cast

import numba
import platformdirs

from pliant.spec.arrays import FloatArray

F = TypeVar("F", bound=Callable[..., Any])

KEPT: Final = 4
"""Cache folders kept of a module: those used last."""

_IMPORT: Final = re.compile(rb"^from ([\w.]+) import", re.MULTILINE)


def compiled(function: F) -> F:
    """Compile a function when it is first called; it releases the interpreter lock."""
    with _cache_of(function) as cache:
        return cast(F, numba.njit(cache=cache, nogil=True)(function))


def inlined(function: F) -> F:
    """Compile a function into the compiled functions that call it."""
    with _cache_of(function) as cache:
        return cast(F, numba.njit(cache=cache, nogil=True, inline="always")(function))


def elementwise(function: Callable[..., float]) -> Callable[..., FloatArray]:
    """Compile a function of float64 numbers into a NumPy universal function, when first called.

    Loading one takes Numba's compiler, half a second that a process without geometry saves.
    """
    signature = f"float64({', '.join(['float64'] * function.__code__.co_argcount)})"

    @functools.cache
    def loaded() -> Callable[..., FloatArray]:
        with _cache_of(function) as cache:
            made: Callable[..., FloatArray] = numba.vectorize([signature], cache=cache)(function)
            return made

    return lambda *arguments: loaded()(*arguments)


@functools.cache
def source_digest(module: str) -> str:
    """Return 16 hexadecimal digits that change with everything a module compiles.

    Args:
        module: An imported module, such as `pliant.generator.truth.rasteriser`. What it imports
            from the same room (`pliant.generator`) counts, that from elsewhere does not.
    """
    room = module.split(".")[:2]
    names, waiting = {module}, [module]
    sources: dict[str, bytes] = {}
    while waiting:
        name = waiting.pop()
        sources[name] = Path(str(sys.modules[name].__file__)).read_bytes()
        imported = {each.decode() for each in _IMPORT.findall(sources[name])}
        new = {each for each in imported if each.split(".")[:2] == room} - names
        names |= new
        waiting += new
    digest = hashlib.sha256()
    for name, source in sorted(sources.items()):
        digest.update(name.encode() + b"\0" + hashlib.sha256(source).digest())
    return digest.hexdigest()[:16]


@contextmanager
def _cache_of(function: Callable[..., Any]) -> Iterator[bool]:
    """Make Numba choose the folder of a function's module; yield whether there is one."""
    folder = _cache_folder(function.__module__)
    config: Any = numba.config
    before = config.CACHE_DIR
    if folder is not None:
        config.CACHE_DIR = str(folder)
    try:
        yield folder is not None
    finally:
        config.CACHE_DIR = before


@functools.cache
def _cache_folder(module: str) -> Path | None:
    """Return a module's cache folder, made if need be; None where nothing can be written."""
    base = _cache_base()
    if base is None:
        return None
    name = module.rpartition(".")[2]
    folder = base / f"{name}-{source_digest(module)}"
    try:
        if not folder.is_dir():
            folder.mkdir(exist_ok=True)
            others = sorted(base.glob(f"{name}-" + "[0-9a-f]" * 16), key=_last_use, reverse=True)
            for old in others[KEPT:]:
                shutil.rmtree(old, ignore_errors=True)
        os.utime(folder)
    except OSError:
        return None
    return folder


def _last_use(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except OSError:  # another process has removed it
        return 0.0


@functools.cache
def _cache_base() -> Path | None:
    """Return the folder of all cache folders, None where it cannot be written.

    It is in `NUMBA_CACHE_DIR` if that is set, else in the user's cache folder (`XDG_CACHE_HOME`).
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    base = Path(named) / "pliant" if named else platformdirs.user_cache_path("pliant") / "numba"
    try:
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return None
    return base if os.access(base, os.W_OK) else None
