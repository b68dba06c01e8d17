"""Dense pixel correspondence on deformable objects: datasets, methods, scores.

    ds = pliant.load("DATA")
    answers = pliant.predict(ds, "sift")
    scores = pliant.evaluate(ds, answers)

The other packages, such as `pliant.spec` and `pliant.evaluator`, are imported by their names.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pliant.api import evaluate, load, open_method, predict, stream, validate

__version__ = "0.1.0"
__all__ = ["__version__", "evaluate", "load", "open_method", "predict", "stream", "validate"]


def __getattr__(name: str) -> Any:
    """Import a public function when it is first asked for."""
    if name in __all__:
        from pliant import api

        return getattr(api, name)
    raise AttributeError(f"module 'pliant' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
