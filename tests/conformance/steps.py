"""Carries out the steps of a case: `{EDIT: PATH, OPTION: VALUE}` calls the edit of that name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from tests.conformance import changes, edits, image_changes, motion, publications
from tests.conformance.edits import Edit

_CHANGED: Final[dict[str, Callable[..., Edit]]] = {
    "bytes": edits.change_bytes,
    "json": edits.change_json,
    "rows": edits.change_rows,
    "footer": edits.change_footer,
    "table": edits.change_table,
    "exr": edits.change_exr,
    "pictures": image_changes.change_pictures,
}
"""Edits that take a function of a module of changes, `by: NAME` or `by: [NAME, ARGUMENT …]`."""

_OF_DOCUMENTS: Final = ("json", "rows", "footer")
"""Those that can also take the changes of `edits.change_document`."""

_PLAIN: Final[dict[str, Callable[..., Edit]]] = {
    "remove": edits.remove,
    "write": edits.write_text,
    "png": edits.write_png,
    "link": edits.link,
    "copy": edits.copy,
    "foreign": edits.store_as,
    "swap": edits.swap,
    "rewrite": edits.rewrite,
    "rebind": edits.rebind,
    "fill": image_changes.fill,
    "relist": lambda _: edits.listed(),
}


def perform(root: Path, steps: Sequence[Mapping[str, Any]]) -> None:
    """Carry out the steps of a case, in order.

    Args:
        root: A copy of the base dataset.
        steps: Each with the name of an edit first; `call` names a function of
            `publications` or `motion`.
    """
    for step in steps:
        (verb, path), *rest = step.items()
        options = dict(rest)
        if verb == "call":
            module = publications if hasattr(publications, path) else motion
            getattr(module, path)(root, **options)
        elif verb in _CHANGED:
            _changed(verb, edits.whole(path), options)(root)
        else:
            _PLAIN[verb](edits.whole(path), **options)(root)


def _changed(verb: str, path: str, options: dict[str, Any]) -> Edit:
    by = options.pop("by", None)
    if by is None:
        if verb not in _OF_DOCUMENTS:
            return _CHANGED[verb](path, lambda subject: subject, **options)
        return _CHANGED[verb](path, partial(edits.change_document, **options))
    name, *arguments = [by] if isinstance(by, str) else by
    module = changes if hasattr(changes, name) else image_changes
    function = getattr(module, name)
    return _CHANGED[verb](path, lambda subject: function(subject, *arguments), **options)
