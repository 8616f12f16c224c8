"""What a page asks reaches the call that does it."""

from collections.abc import Callable
from typing import Any

import pytest

from tis.deploy.view.requests import PageRequest, ask


class _Noted:
    """Notes each call, and answers with its name."""

    def __getattr__(self, name: str) -> Callable[..., None]:
        def call(*given: Any) -> None:
            *values, on_answer = given
            on_answer(f"{name}{tuple(values)}")

        return call


@pytest.mark.parametrize(
    ("content", "call"),
    [
        ({"ask": "stop"}, "stop()"),
        ({"ask": "release"}, "release()"),
        ({"ask": "reset"}, "reset()"),
        ({"ask": "outage", "way": "feedback", "value": 500}, "outage('feedback', 500.0)"),
        ({"ask": "delay", "value": 0}, "set_stage('both', 'delay.delay_ms=0')"),
        ({"ask": "loss", "way": "forward", "value": 2.5}, "set_stage('forward', 'loss.p_loss=0.025')"),
        ({"ask": "profile", "profile": "paper_1"}, "profile('paper_1',)"),
        ({"ask": "task", "value": 300}, "only_delay(150.0,)"),
    ],
)
def test_each_request_is_the_call_that_does_it(content: dict[str, Any], call: str) -> None:
    told: list[str] = []
    ask(_Noted(), PageRequest(**content), told.append)  # type: ignore[arg-type]
    assert told == [call]
