"""What is told before the first message passes: the library's own figures, and everything that changes them."""

from typing import Any, Final

import pytest

from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.capacity import MAX_COUNT
from tis.deploy.net.profiles import find_profile
from tis.netem.expected.figures import direction_figures
from tis.netem.expected.synopsis import synopsis

SLOW: Final = {"delay": {"kind": "constant", "delay_ms": 40}}
STATES: Final = {
    "kind": "cycle",
    "states": [{"name": "good", "for_s": 3}, {"name": "bad", "for_s": 1, "forward": {"add_delay_ms": 8}}],
}


@pytest.mark.parametrize(
    ("network", "lines"),
    [
        ({}, ("nothing injected", "nothing injected")),
        ({"forward": SLOW}, ("delay 40 ms, sd 0", "nothing injected")),
        (
            {"outages": [{"kind": "periodic", "every_s": 4, "for_s": 1, "direction": "feedback"}]},
            ("nothing injected", "outages 25 % of the time"),
        ),
        (
            {"outages": [{"kind": "periodic", "every_s": 4, "for_s": 1, "direction": "forward", "effect": "stall"}]},
            ("stalls 25 % of the time", "nothing injected"),
        ),
        (
            {"forward": SLOW, "states": STATES},
            ("delay 42 ms, sd 3.46 as drawn, states good/bad in a cycle of 4 s", "states good/bad in a cycle of 4 s"),
        ),
        (
            {
                "forward": {"loss": {"kind": "bernoulli", "p_loss": 0.0001, "mtu_bytes": 500}},
                "feedback": {"loss": {"kind": "bernoulli", "p_loss": 0.1, "mtu_bytes": 500}},
                "states": {
                    "kind": "cycle",
                    "states": [
                        {"name": "good", "for_s": 1},
                        {"name": "bad", "for_s": 1, "forward": {"add_p_loss": 0.2}},
                    ],
                },
            },  # what states add concerns messages, whatever their size
            (
                "loss 0.01 % of each packet of 500 bytes, and by states 10 % of each whole message, "
                "states good/bad in a cycle of 2 s",
                "loss 10 % of each packet of 500 bytes, states good/bad in a cycle of 2 s",
            ),
        ),
        (
            {
                "forward": {
                    "ordering": "reorder",
                    "duplicate": {"p_duplicate": 0.03},
                    "corrupt": {"p_corrupt": 0.02},
                    "reorder": {"p_reorder": 0.25},
                    "delay": {"kind": "constant", "delay_ms": 40},
                },
                "feedback": {"ordering": "drop_late"},
            },
            (
                "delay 40 ms, sd 0, duplicate 3 %, corrupt 2 %, reorder 25 %, messages overtake (ordering reorder)",
                "overtaken ones dropped (ordering drop_late)",
            ),
        ),
        (
            {"timeline": [{"at_s": 1, "set": {}}, {"at_s": 2, "direction": "forward", "set": {"outage": True}}]},
            ("timeline of 2", "timeline of 1"),
        ),
        (
            {"rules": [{"key": "a", "direction": "both", "pipeline": SLOW}, {"key": "b", "direction": "forward"}]},
            ("2 rules", "1 rule"),
        ),
        (
            {
                "states": {
                    "kind": "script",
                    "states": [{"name": "out", "forward": {"outage": True}, "feedback": {"rate": {"kbit_s": 8}}}],
                    "steps": [{"at_s": 0, "state": "out"}],
                }
            },
            (
                "nothing arrives, outages 100 % of the time, states out",
                "rate 8 kbit/s (queue of 1000 messages), states out",
            ),
        ),
    ],
)
def test_everything_that_is_asked_for_is_said(network: dict[str, Any], lines: tuple[str, str]) -> None:
    for rule in network.get("rules", ()):
        rule.setdefault("pipeline", {})
    forward, feedback = lines
    assert synopsis(NetworkPart.model_validate(network), {}) == [
        f"forward (west to east): {forward}",
        f"feedback (east to west): {feedback}",
    ]


@pytest.mark.parametrize("name", ["starlink_2022_eu", "lte_netfi", "wifi_bad"])
def test_a_profile_s_line_has_the_figures_of_the_library(name: str) -> None:
    network = find_profile(name).network
    of = direction_figures(network, "forward")
    line = synopsis(network, {})[0]
    assert f"delay {of.mean_ms:.4g} ms, sd {of.std_ms:.3g}" in line
    assert (f"loss {of.loss_pct:.3g} %" in line) == (of.loss_pct > 0)


@pytest.mark.parametrize(
    ("pipeline", "words"),
    [
        ({"loss": {"kind": "bernoulli", "p_loss": 0.01}}, "loss 1 %"),
        (
            {"loss": {"kind": "bernoulli", "p_loss": 0.01, "mtu_bytes": 1500}},
            "loss 1 % of each packet of 1500 bytes",
        ),
        ({"loss": {"kind": "burst", "p_loss": 0.01, "mean_burst": 3}}, "loss 1 % in bursts of 3 on average"),
        ({"rate": {"kbit_s": 2500}}, "rate 2.5 Mbit/s (queue of 1000 messages)"),
        (
            {"rate": {"kbit_s": 2500, "queue": {"kind": "tail_drop", "max_packets": MAX_COUNT}}},
            "rate 2.5 Mbit/s (queue without a bound)",
        ),
        (
            {"rate": {"kbit_s": 2500, "queue": {"kind": "tail_drop", "max_packets": MAX_COUNT, "max_bytes": 9000}}},
            "rate 2.5 Mbit/s (queue of 9000 bytes)",
        ),
        (
            {
                "rate": {
                    "kbit_s": 64,
                    "overhead_bytes": 42,
                    "queue": {"kind": "codel", "max_packets": 50, "max_bytes": 20000},
                }
            },
            "rate 64 kbit/s (CoDel queue, target 5 ms, of 50 messages or 20000 bytes, 42 bytes on top of each)",
        ),
        (
            {"rate": {"kbit_s": 64, "queue": {"kind": "priority"}, "backpressure": True}},
            "rate 64 kbit/s (priority queue of 1000 messages, senders wait while it is full)",
        ),
    ],
)
def test_loss_says_of_what_and_a_rate_how_much(pipeline: dict[str, Any], words: str) -> None:
    assert synopsis(NetworkPart.model_validate({"forward": pipeline}), {})[0] == f"forward (west to east): {words}"


def test_a_profile_that_is_out_half_of_the_time_says_so() -> None:
    assert "outages 50 % of the time" in synopsis(find_profile("netfi_clm_3").network, {})[0]
