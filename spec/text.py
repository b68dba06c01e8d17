"""Texts for people, and the characters in them that are refused in files and escaped in output."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from typing import Any, Final

_BIDIRECTIONAL: Final = "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
_BLANK: Final = " \u00a0\u115f\u1160\u2800\u3000\u3164\uffa0"
"""Characters that are as empty as a space."""
_UNSAFE: Final = re.compile(f"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff{_BIDIRECTIONAL}]")
_UNSAFE_BETWEEN_LINES: Final = re.compile(rf"(?![\n\t]){_UNSAFE.pattern}")


def unsafe_character(text: str, *, lines: bool = False) -> str | None:
    """Return the first control, bidirectional or surrogate character of a text, or None.

    Args:
        text: Any text.
        lines: Whether the text may have several lines: line feeds and tabs are allowed.
    """
    found = (_UNSAFE_BETWEEN_LINES if lines else _UNSAFE).search(text)
    return None if found is None else found[0]


def escaped(text: str, *, lines: bool = False) -> str:
    r"""Return a text in which every unsafe character is written as its escape, such as `\u202e`.

    Args:
        text: Any text.
        lines: Whether the text may have several lines: line feeds and tabs are kept.
    """
    return (_UNSAFE_BETWEEN_LINES if lines else _UNSAFE).sub(lambda found: escape(found[0]), text)


def escape(character: str) -> str:
    r"""Return one character as `\xNN` or `\uNNNN`."""
    code = ord(character)
    return f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}"


def shortened(text: str, most: int) -> str:
    """Return a text of at most so many characters; an ellipsis stands for what is left out."""
    return text if len(text) <= most else text[: most - 1] + "…"


def plural(count: int, noun: str) -> str:
    """Return a count with its noun, such as `1 sequence` or `1,200 sequences`."""
    if count != 1:
        noun = f"{noun.removesuffix('y')}ies" if noun.endswith("ry") else f"{noun}s"
    return f"{count:,} {noun}"


def duration(seconds: float) -> str:
    """Return a length of time for people."""
    if seconds < 90:
        return f"{seconds:.1f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def number_in(text: str) -> float:
    """Return the number that a text is, as `float`, which alone would read `1_0` as 10.

    Raises:
        ValueError: It is not a number.
    """
    if "_" in text:
        raise ValueError(f"not a number: {text!r}")
    return float(text)


def number_order(name: str) -> list[str | int]:
    """Return a key that sorts names as people number them: `frame2` before `frame10`."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


def name_fault(name: str) -> str | None:
    """Return why a text cannot be shown as a name, in words, or None for a good name.

    A name is not blank and has no control, zero-width, bidirectional or surrogate character.
    """
    if not name.strip(_BLANK):
        return "a blank name"
    invisible = ("Cc", "Cf", "Cs", "Zl", "Zp")
    found = next((each for each in name if unicodedata.category(each) in invisible), None)
    return None if found is None else f"the character {escape(found)}"


def texts_of(document: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Yield (place, text) for every key and every text of parsed JSON.

    Args:
        document: Parsed JSON of bounded depth.
        place: Place of the document itself.
    """
    if isinstance(document, str):
        yield place, document
    elif isinstance(document, dict):
        for key, value in document.items():
            inner = f"{place}.{escaped(key)}" if place else escaped(key)
            yield inner, key
            yield from texts_of(value, inner)
    elif isinstance(document, list):
        for index, value in enumerate(document):
            yield from texts_of(value, f"{place}[{index}]")


def shown(value: Any) -> Any:
    """Return a value for a page template: a plain text escaped, anything else as it is."""
    return escaped(value, lines=True) if type(value) is str else value
