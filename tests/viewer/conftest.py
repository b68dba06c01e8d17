"""The cards of the baselines' tests, for match figures, and one browser for all pages."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from pliant.baselines import Frame
from tests.baselines.conftest import Similarity, card_view
from tests.browser import CHROMIUM, DRIVER, Browser, chromium


@pytest.fixture(scope="session")
def pose() -> type[Similarity]:
    """How a card is placed in a picture."""
    return Similarity


@pytest.fixture(scope="session")
def view_of() -> Callable[[Similarity], Frame]:
    """A function: placement -> the view of a card."""
    return card_view


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One headless browser."""
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("chromium and chromedriver are not installed")
    with chromium() as window:
        yield window
