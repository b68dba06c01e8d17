"""The explorer's addresses: frames are looked up, and what is wrong is one sentence."""

from __future__ import annotations

import json
from urllib.parse import quote

import pytest

from pliant.spec.answers import Answers
from pliant.spec.frame import Pair
from tests.viewer.explorer.conftest import Shifted
from tests.viewer.serving import ask, below

HUGE = "rope-test-000000/" + "9" * 5000


@pytest.mark.parametrize(
    "frame",
    ["../../dataset/0", "rope-test-000000/../0", "rope-test-000000/-1", "/0", "x/9999", "", HUGE],
)
def test_frames_are_looked_up_and_never_paths(address: str, frame: str) -> None:
    for call in ("layer?layer=rgb&frame=", "scene?frame=", "pose?frame=", "truth?u=1&v=1&b=x/0&a="):
        status, body = ask(address, below(address, f"api/{call}{quote(frame, safe='')}"))
        assert status == 400
        assert b"no such frame" in body


def test_wrong_parameters_get_one_sentence_and_nothing_can_be_written(address: str) -> None:
    pair = "a=rope-test-000000/0&b=rope-test-000001/0"
    for call, said in (
        (f"truth?{pair}&u=nan&v=1", b"two numbers"),
        (f"truth?{pair}", b"two numbers"),
        (f"answer?{pair}&u=1&v=1&method=7", b"unknown method"),
        (f"answer?{pair}&u=1&v=1&method={'9' * 5000}", b"unknown method"),
        (f"answer?{pair}&u=1&v=1", b"unknown method"),
        ("layer?layer=secret&frame=rope-test-000000/0", b"unknown layer"),
        ("truth?a=rope-test-000000/0&b=cloth-1-test-000000/0&u=1&v=1", b"different tiers"),
    ):
        status, body = ask(address, below(address, f"api/{call}"))
        assert (status, said in body) == (400, True), body
    for method in ("POST", "PUT", "DELETE", "PATCH"):
        assert ask(address, below(address, "api/dataset"), method)[0] == 405


def test_an_error_of_a_method_of_ones_own_is_said(
    address: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(method: Shifted, pair: Pair) -> Answers:
        raise RuntimeError("no weights")

    monkeypatch.setattr(Shifted, "answer", broken)
    call = "api/warm?a=rope-test-000000/0&b=rope-test-000001/0&method=0"
    status, body = ask(address, below(address, call))
    assert (status, json.loads(body)) == (500, {"error": "RuntimeError: no weights"})
    assert "warm failed" in caplog.text
    assert "in broken" in caplog.text
