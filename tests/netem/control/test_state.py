import json
from typing import Any, get_args

from tests.netem.making import link, offer, packet
from tis.common.channels import Direction
from tis.common.scenario.control import EmulatorState, RecentDelays
from tis.netem.control.control import Control, describe, snapshot
from tis.netem.link.link import Link

MS = 1_000_000


def _state(control: Control, now_ns: int) -> dict[str, Any]:
    told = describe(snapshot(control.links, now_ns), now_ns, {"unsent": 2})
    text = told.model_dump_json(exclude_none=True)
    assert EmulatorState.model_validate_json(text) == told
    state: dict[str, Any] = json.loads(text)
    return state


def test_the_state_says_what_holds_and_what_was_asked_for() -> None:
    network: dict[str, Any] = {
        "forward": {"delay": {"kind": "constant", "delay_ms": 5}},
        "rules": [{"key": "tis/x", "direction": "forward", "pipeline": {"ordering": "reorder"}}],
        "states": {"kind": "cycle", "states": [{"name": "bad", "for_s": 60, "feedback": {"add_delay_ms": 3}}]},
        "unmatched": "pass",
    }
    links: dict[Direction, Link] = {way: link(way, **network) for way in get_args(Direction)}
    control = Control(links)
    request = {"direction": "forward", "change": {"loss": {"kind": "bernoulli", "p_loss": 0}}, "for_s": 2}
    control.handle("set", json.dumps(request).encode(), 999 * MS)
    offer(links["forward"], packet(1_500 * MS), 1_500 * MS)
    state = _state(control, 1_500 * MS)
    delay, loss = {"kind": "constant", "delay_ms": 5.0}, {"kind": "bernoulli", "p_loss": 0.0}
    forward, feedback = state.pop("forward"), state.pop("feedback")
    assert not state.pop("standalone")
    assert state == {
        "running": True,
        "at_s": 1.5,
        "unmatched": "pass",
        "counters": {"unsent": 2},
    }
    assert forward["counters"]["offered"] == 1
    assert forward["counters"]["held_at_end"] == 1
    del forward["counters"], feedback["counters"]
    assert forward == {
        "state": "bad", "outage": False, "stall": False, "scale_rate": 1.0,
            "scale_delay": 1.0, "add_delay_ms": 0.0, "add_p_loss": 0.0, "until_s": 3.0,
        "pipeline": {"delay": delay, "ordering": "fifo"},
        "now": {"delay": delay, "loss": loss, "ordering": "fifo"},
        "rules": [
            {"key": "tis/x", "pipeline": {"ordering": "reorder"}, "now": {"loss": loss, "ordering": "reorder"}}
        ],
        "added": [{"at_s": 1.0, "for_s": 2.0, "ramp_s": 0.0, "direction": "forward", "set": {"loss": loss}}],
    }  # fmt: skip
    assert feedback == {
        "state": "bad", "outage": False, "stall": False, "scale_rate": 1.0,
        "scale_delay": 1.0, "add_delay_ms": 3.0, "add_p_loss": 0.0,
        "pipeline": {"ordering": "fifo"}, "now": {"ordering": "fifo"}, "rules": [], "added": [],
    }  # fmt: skip


def test_an_emulator_by_itself_tells_the_delays_of_what_left_lately() -> None:
    links: dict[Direction, Link] = {way: link(way) for way in get_args(Direction)}
    found = RecentDelays(within_s=5, n=10, p50_ms=20, p99_ms=31)
    told = describe(snapshot(links, MS), MS, delays={"forward": found, "feedback": None})
    assert told.standalone
    assert told.forward is not None
    assert told.feedback is not None
    assert (told.forward.delays, told.feedback.delays) == (found, None)


def test_without_a_run_there_is_nothing_to_tell() -> None:
    assert describe(None, None) == EmulatorState(running=False)
