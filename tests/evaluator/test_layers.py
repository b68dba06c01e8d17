"""Inside the evaluator, imports point one way."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2] / "evaluator"

# A module imports from its own layer and from those before it.
LAYERS = (
    {"statistics", "submission"},
    {"metrics"},
    {"protocols"},
    {"controls", "truth_hints", "examples", "scores"},
    {"scoring"},
    {"evaluate"},
    {"hidden_truth", "comparison"},
    {"report"},
)


def layer(part: str) -> int:
    (found,) = [index for index, names in enumerate(LAYERS) if part in names]
    return found


def test_no_import_points_up() -> None:
    seen = set()
    for path in sorted(ROOT.rglob("*.py")):
        own = path.relative_to(ROOT).parts[0].removesuffix(".py")
        if own == "__init__":
            continue
        seen.add(own)
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
                "pliant.evaluator."
            ):
                other = str(node.module).split(".")[2]
                assert layer(other) <= layer(own), f"{path} imports {node.module}"
    assert seen == set.union(*LAYERS)
