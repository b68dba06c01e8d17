"""Finds the class of a family of metrics that a protocol names."""

from __future__ import annotations

import functools
import importlib
from typing import Any

from pliant.evaluator.metrics.base import Metric
from pliant.spec.errors import CallError


@functools.cache
def metric_class(family: str) -> type[Metric[Any]]:
    """Return the class of a family of metrics.

    Args:
        family: Name of a module in `evaluator/metrics/`, whose class has the same name in title
            case; or `module:Class` for a class elsewhere.

    Raises:
        CallError: The class is unknown.
    """
    module, _, name = family.partition(":")
    if not name:
        module, name = f"pliant.evaluator.metrics.{family}", family.title()
    try:
        found: type[Metric[Any]] = getattr(importlib.import_module(module), name)
    except (ModuleNotFoundError, AttributeError) as error:
        raise CallError(
            "no such family of metrics", found=repr(family), required=f"class {name} in {module}"
        ) from error
    return found
