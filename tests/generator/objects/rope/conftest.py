"""Lets the tests of this folder import `rope_checks`, the checks they share."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
