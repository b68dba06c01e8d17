"""Random requests by the OpenAPI document: whatever is sent, no answer is a fault."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from pliant.service.web import throttle
from pliant.service.web.app import make_app
from tests.service.conftest import MakeTrial

schemathesis = pytest.importorskip("schemathesis")


@pytest.mark.parametrize("examples", [2, pytest.param(150, marks=pytest.mark.long)])
def test_no_request_is_answered_with_500(
    make_trial: MakeTrial, examples: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(throttle.Throttle, "check", lambda self, client: None)
    trial = make_trial("submissions_per_minute: 1000\n")
    trial.send(b"good")
    trial.send(b"bad")
    trial.work()
    schema = schemathesis.openapi.from_asgi("/api/v1/openapi.json", make_app(trial.challenge))
    requests = 0
    for operation in (each.ok() for each in schema.get_all_operations()):
        for token in (None, trial.tokens[0], trial.host):
            requests += fuzz(operation, token, examples)
    assert requests >= examples * 10


def fuzz(operation: Any, token: str | None, examples: int) -> int:
    """Send random requests for one operation, and return how many."""
    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    statuses: list[int] = []

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(case=operation.as_strategy())
    def check(case: Any) -> None:
        answer = case.call(headers=headers)
        statuses.append(answer.status_code)
        assert answer.status_code < 500, answer.text

    check()
    return len(statuses)
