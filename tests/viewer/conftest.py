"""The cards of the baselines' tests, for match figures."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pliant.baselines import View
from tests.baselines.conftest import Similarity, card_view


@pytest.fixture(scope="session")
def pose() -> type[Similarity]:
    """How a card is placed in a picture."""
    return Similarity


@pytest.fixture(scope="session")
def view_of() -> Callable[[Similarity], View]:
    """A function: placement -> the view of a card."""
    return card_view
