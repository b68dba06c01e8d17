from __future__ import annotations

import pytest

from tests.generator.runner.standin import digests, make


@pytest.fixture(scope="session")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Digests of the small stand-in set made at once by one worker."""
    out = tmp_path_factory.mktemp("uninterrupted") / "set"
    make(out)
    return digests(out)
