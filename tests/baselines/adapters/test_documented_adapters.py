"""The examples of docs/your-method.md run as they stand, and are short."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).resolve().parents[3] / "docs" / "your-method.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
MOST_LINES = 12


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: re.findall(r"from_\w+", block)[0])
def test_example(block: str, tiny_dataset: Path) -> None:
    lines = [line for line in block.splitlines() if line and not re.match(r"from|import", line)]
    assert len(lines) <= MOST_LINES
    values: dict[str, object] = {}
    exec(compile(block.replace('"DATA"', repr(str(tiny_dataset))), str(PAGE), "exec"), values)
    answers = values["answers"].answers  # type: ignore[attr-defined]
    assert len(answers.uv_px) > 100
    assert len(np.unique(answers.uv_px, axis=0)) > 50
