"""The page's controls, down to the links of an emulator at work."""

import queue
import threading
from collections.abc import Callable

import pytest

from tests.common.runtime.live_zenoh import soon
from tests.netem.bridge.controlled_bridge import Running, running_bridge
from tis.common.runtime.emulator_client import EmulatorAddress
from tis.common.runtime.ports import free_endpoints
from tis.common.scenario.network.delay import NormalJitter
from tis.deploy.net.emergency import Stopped, Token
from tis.deploy.view import steering as module
from tis.deploy.view.steering import Steering, live_profiles

pytestmark = pytest.mark.live


def _ask(act: Callable[[Callable[[str], None]], None]) -> str:
    told: queue.Queue[str] = queue.Queue()
    act(told.put)
    return told.get(timeout=60)


def _delay_ms(bridge: Running, way: str) -> float | None:
    state = EmulatorAddress(bridge.endpoint)
    steering = Steering(state)
    try:
        assert soon(lambda: steering.state() is not None)
        found = steering.state()
        assert found is not None
        one = found.forward if way == "forward" else found.feedback
        assert one is not None
        return getattr(one.now.delay, "delay_ms", None)
    finally:
        steering.close()


def test_every_button_reaches_the_links() -> None:
    with running_bridge() as bridge:
        steering = Steering(EmulatorAddress(bridge.endpoint))
        try:
            answer = _ask(lambda tell: steering.set_stage("forward", "delay.delay_ms=70", tell))
            assert answer.startswith("done, from ")
            assert _delay_ms(bridge, "forward") == 70
            assert _delay_ms(bridge, "feedback") != 70
            assert _ask(lambda tell: steering.outage("both", 60_000, tell)).startswith("done")
            assert soon(lambda: bridge.bridge.in_outage("forward") and bridge.bridge.in_outage("feedback"))
            assert _ask(lambda tell: steering.reset(tell)).startswith("done")
            assert soon(lambda: not bridge.bridge.in_outage("forward"))
            assert _ask(lambda tell: steering.set_stage("both", "loss.p_loss=0.5", tell)).startswith("done")
            assert _ask(lambda tell: steering.only_delay(150, tell)).startswith("done")
            assert _delay_ms(bridge, "forward") == _delay_ms(bridge, "feedback") == 150
            found = steering.state()
            assert found is not None
            assert found.forward is not None
            assert found.forward.now.loss == found.forward.pipeline.loss, "all else is the scenario's own"
            assert _ask(lambda tell: steering.profile("paper_1", tell)).startswith("done")
            assert _ask(lambda tell: steering.outage("both", -1, tell)).startswith("refused: for_ms")
            assert _ask(lambda tell: steering.set_stage("both", "delay.nonsense=1", tell)).startswith("not done: ")
        finally:
            steering.close()


def test_a_tasks_delay_is_that_of_every_message() -> None:
    way = {"delay": {"kind": "constant", "delay_ms": 50}, "jitter": {"kind": "normal", "std_ms": 5}}
    with running_bridge(forward=way) as bridge:
        steering = Steering(EmulatorAddress(bridge.endpoint))
        try:
            assert _ask(lambda tell: steering.only_delay(0, tell)).startswith("done")
            found = steering.state()
            assert found is not None
            assert found.forward is not None
            assert found.forward.pipeline.jitter == NormalJitter(kind="normal", std_ms=5)
            assert found.forward.now.jitter == NormalJitter(kind="normal", std_ms=0)
        finally:
            steering.close()


def test_without_an_emulator_it_says_so() -> None:
    steering = Steering(EmulatorAddress(free_endpoints()[0]))
    try:
        assert steering.state() is None
        answer = _ask(steering.reset)
        assert answer.startswith("not done: ")
        assert "cannot connect" in answer
    finally:
        steering.close()


def test_the_profiles_offered_are_those_that_can_be_taken_on_while_running() -> None:
    titles = live_profiles()
    assert {"paper_1", "wifi_bad"} <= set(titles)
    assert all(titles.values()), "each with a word about it"
    assert "starlink_2022_eu" not in titles  # it changes with time by itself


def test_a_release_has_the_secret_of_a_stop_that_is_seen_before_its_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    answered, told = threading.Event(), queue.Queue[str]()

    def stops(*_: object) -> Stopped:
        answered.wait(60)
        return Stopped("stopped", Token(7, "secret"))

    monkeypatch.setattr(module, "stop_arms", stops)
    monkeypatch.setattr(module, "release_all", lambda _, known: str(known))
    steering = Steering(EmulatorAddress(free_endpoints()[0]))
    steering.stop(told.put)
    steering.release(told.put)
    answered.set()
    assert [told.get(timeout=60) for _ in range(2)] == ["stopped", "{7: 'secret'}"]
    steering.close()
