"""Methods outside Pliant: `path/to/my.py:Matcher`, `package.module:Matcher`, entry points."""

from __future__ import annotations

import difflib
import functools
import importlib
import inspect
import sys
import traceback
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from pliant.baselines.adapters import as_matcher
from pliant.baselines.adapters.complete import check_takes_queries, has_ability, required_parameters
from pliant.baselines.matcher import Matcher, SplitMatcher
from pliant.spec.errors import CallError, PliantError

GROUP: Final = "pliant.matchers"
"""The entry-point group in which a package names its methods."""


def plugged_in() -> dict[str, EntryPoint]:
    """Return the entry points of the installed packages by name, sorted."""
    return {each.name: each for each in sorted(entry_points(group=GROUP))}


def is_reference(text: str) -> bool:
    """Return whether a text names an object: `path/to/my.py:Name` or `package.module:Name`."""
    place, colon, name = text.rpartition(":")
    if text.endswith((".py", ".py:")):
        return True  # open_plugin says that the name is missing
    if not colon or not all(part.isidentifier() for part in name.split(".")):
        return False
    return place.endswith(".py") or all(part.isidentifier() for part in place.split("."))


def open_plugin(reference: str, options: Mapping[str, Any]) -> Matcher | SplitMatcher:
    """Return the method of a reference or an entry point.

    Args:
        reference: `path/to/my.py:Name`, `package.module:Name`, or the name of an entry point. The
            object is a class, a function that returns a matcher, a matcher, or a function
            (source, target, queries (N, 2)) -> positions (N, 2).
        options: Keyword arguments of the class or function.

    Raises:
        CallError: It cannot be imported, does not take these options, or is not a method.
    """
    entry = plugged_in().get(reference)
    place, _, name = (entry.value if entry else reference).rpartition(":")
    if not place or not name:
        raise CallError(
            "the class is missing",
            where=reference,
            fix=f"Name it after a colon: {reference.removesuffix(':')}:Matcher",
        )
    found: Any = _module(place, reference)
    for part in name.split("."):
        found = _attribute(found, part, reference)
    made = make(found, reference, options)
    return as_matcher(made, reference if entry else name, options)


def make(found: Any, name: str, options: Mapping[str, Any]) -> Any:
    """Call a class or function with options; another object is returned unchanged.

    Args:
        found: A class, a function that returns a method, a function that matches, or a method.
        name: What it is called, for messages.
        options: Keyword arguments.

    Raises:
        CallError: It does not take these options.
    """
    if not isinstance(found, type) and has_ability(found):
        if options:
            raise CallError(
                "this method takes no options", where=name, found=", ".join(sorted(options))
            )
        return found
    if not callable(found):
        return found  # as_matcher says what is wrong
    matches = not isinstance(found, type) and required_parameters(found) == 3
    if not isinstance(found, type) and not options:
        check_takes_queries(found)
    try:
        inspect.signature(found).bind(*[None] * (3 if matches else 0), **options)
    except TypeError as error:
        taken = [each for each in inspect.signature(found).parameters if each != "self"]
        raise CallError(
            f"the method cannot be made: {error}",
            where=name,
            found=", ".join(f"{key}={value!r}" for key, value in options.items()) or "no options",
            required=f"options {', '.join(taken)}" if taken else "no options",
            fix="Give options as --set key=value, in Python as keyword arguments",
        ) from error
    except ValueError:  # a built-in without a signature
        pass
    if matches:
        return functools.partial(found, **options) if options else found
    return found(**options)


def _module(place: str, reference: str) -> ModuleType:
    """Import a file or a module; its folder is then the last on the path, for its neighbours."""
    if not place.endswith(".py"):
        if str(Path.cwd()) not in sys.path:
            sys.path.append(str(Path.cwd()))
        return _imported(place, reference)
    path = Path(place).resolve()
    if not path.is_file():
        raise CallError("file not found", path=place)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # not first: it would hide the standard library
    module = _imported(path.stem, reference)
    if Path(str(module.__file__)).resolve() != path:
        raise CallError(
            f"another module is called {path.stem!r}",
            path=place,
            found=module.__file__,
            fix="Rename the file",
        )
    return module


def _imported(name: str, reference: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except PliantError:
        raise
    except Exception as error:  # whatever the user's code raises
        last = traceback.extract_tb(error.__traceback__)[-1]
        at = f" ({last.filename}, line {last.lineno})" if "importlib" not in last.filename else ""
        raise CallError(
            "the module cannot be imported",
            where=reference,
            found=f"{type(error).__name__}: {error}{at}",
        ) from error


def _attribute(owner: Any, name: str, reference: str) -> Any:
    if hasattr(owner, name):
        return getattr(owner, name)
    public = [
        each
        for each, value in vars(owner).items()
        if callable(value)
        and each[0] != "_"
        and getattr(value, "__module__", None) == getattr(owner, "__name__", "")
    ]
    close = difflib.get_close_matches(name, public, n=1)
    raise CallError(
        f"{name!r} was not found in the module",
        where=reference,
        required=f"one of {', '.join(public)}" if 0 < len(public) <= 12 else None,
        fix=f"Did you mean {close[0]}?" if close else None,
    )
