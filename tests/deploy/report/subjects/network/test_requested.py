"""What is asked of each packet, against the vectorised path that decides it under the same conditions."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.deploy.report.hand_made import COMMAND, MS, a_scenario, write_run
from tests.netem.making import are_alike, link, offer, packet
from tis.common.node import Record
from tis.common.records import CONTROL, ControlNote
from tis.common.scenario import Scenario
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import DELIVER
from tis.deploy.report.subjects.network.requested import Requested
from tis.netem.conditions.conditions import Conditions
from tis.netem.expected.simulate import simulate

STATES = {
    "kind": "markov",
    "states": [
        {"name": "good", "mean_s": 0.4, "next": [{"to": "bad"}]},
        {
            "name": "bad",
            "mean_s": 0.2,
            "next": [{"to": "good"}],
            "forward": {"scale_delay": 3, "add_delay_ms": 7, "add_p_loss": 0.3},
        },
    ],
}
NETWORK = {
    "forward": {
        "delay": {"kind": "uniform", "low_ms": 10, "high_ms": 20},
        "loss": {"kind": "bernoulli", "p_loss": 0.05, "mtu_bytes": 100},
    },
    "states": STATES,
    "timeline": [
        {"at_s": 20, "for_s": 1, "set": {"outage": True}},
        {"at_s": 30, "for_s": 20, "ramp_s": 0.5, "set": {"add_delay_ms": 40}},
        {"at_s": 70, "set": {"delay": {"kind": "constant", "delay_ms": 90}}},
    ],
}


def _scenario(network: object = NETWORK, **changes: object) -> Scenario:
    return a_scenario(120.0, network=network, **changes)


def _requested(scenario: Scenario) -> Requested:
    return Requested.of(scenario, "forward", RunLogs(Path()))


def _fates(offered_ns: np.ndarray, n_bytes: int = 80) -> Frame:
    n = len(offered_ns)
    zeros = np.zeros(n, dtype=np.int64)
    return Frame.of_arrays(
        (COMMAND,), key=zeros, foreign=zeros.astype(bool), seq=np.arange(n), offered_ns=offered_ns,
        outcome=zeros + DELIVER, delay_ns=zeros, release_ns=zeros, n_bytes=zeros + n_bytes, copies=zeros,
        flipped=zeros,
    )  # fmt: skip


def test_what_is_asked_of_packets_is_what_the_models_draw() -> None:
    """120 s of states, an outage, a ramp, a step: means over each second agree; 100 bytes are one packet, 101 two."""
    offered_ns = np.arange(120_000) * MS
    scenario = _scenario()
    for n_bytes, n_packets in ((100, 1), (101, 2)):
        expected = _requested(scenario).of_packets(COMMAND, _fates(offered_ns, n_bytes))
        assert expected is not None
        drawn = simulate(scenario.network, "forward", scenario.seed, offered_ns, n_bytes, key=COMMAND)
        assert np.array_equal(expected.outage, drawn.outage)
        modelled = ~drawn.outage
        assert expected.p_loss[modelled].mean() == pytest.approx(drawn.lost[modelled].mean(), rel=0.03)
        assert expected.p_loss.min() == pytest.approx(1 - 0.95**n_packets)
        through = ~drawn.lost
        residual_ms = np.where(through, drawn.delay_ns - expected.delay_ns, 0).reshape(120, -1) / 1e6
        spread_ms = np.sqrt((expected.std_ns**2).reshape(120, -1).mean(axis=1) / 1000) / 1e6
        assert np.abs(residual_ms.mean(axis=1) / np.maximum(spread_ms, 1e-6)).max() < 4


def test_the_conditions_of_many_instants_are_those_of_each() -> None:
    scenario = _scenario()
    instants = np.random.default_rng(1).integers(0, 100_000 * MS, 500)
    held = _requested(scenario).in_force(instants)
    alone = Conditions.of(scenario.network, "forward", scenario.seed)
    for instant, which in zip(instants.tolist(), held.which.tolist(), strict=True):
        assert are_alike(held.conditions[which], alone.at(instant))


@settings(deadline=None, max_examples=20)
@given(st.lists(st.integers(0, 3_000 * MS), max_size=30))
def test_equal_conditions_have_one_number(instants: list[int]) -> None:
    held = _requested(_scenario()).in_force(np.array(instants, dtype=np.int64))
    assert len(set(held.conditions)) == len(held.conditions)
    assert set(held.which.tolist()) == set(range(len(held.conditions)))


def test_a_rule_has_its_own_pipeline_and_a_strangers_key_none() -> None:
    rule = {
        "key": "tis/*/setpoint_cp",
        "direction": "forward",
        "pipeline": {"delay": {"kind": "constant", "delay_ms": 3}},
    }
    requested = _requested(_scenario({**NETWORK, "rules": [rule], "states": None, "timeline": []}))
    setpoint = requested.base("tis/PSM2/setpoint_cp")
    assert setpoint is not None
    assert setpoint.mean_ns == 3 * MS
    assert not requested.varies
    assert requested.pipeline("demo/chat") is None
    assert requested.base("demo/chat") is None
    assert requested.of_packets("demo/chat", _fates(np.array([5]))) is None


def _added(**entry: float) -> str:
    return json.dumps([{"at_s": 0, "direction": "forward", "set": {"add_delay_ms": 1}, **entry}])


def test_rates_of_states_and_changes_while_running_are_known(tmp_path: Path) -> None:
    limited = {"timeline": [{"at_s": 1, "set": {"rate": {"kbit_s": 64}}}]}
    assert _requested(_scenario(limited)).may_limit_rate
    assert not _requested(_scenario()).may_limit_rate
    notes = [
        ControlNote(at_ns=1, applied_ns=0, request="{", accepted=False, reason="junk"),
        ControlNote(at_ns=4 * MS, applied_ns=5 * MS, request="{}", accepted=True, added=_added(for_s=0.010)),
        ControlNote(at_ns=8 * MS, applied_ns=9 * MS, request="{}", accepted=True, added=_added(for_s=0.020)),
        ControlNote(at_ns=50 * MS, applied_ns=51 * MS, request="{}", accepted=True, added=_added()),
        ControlNote(at_ns=60 * MS, applied_ns=61 * MS, operation="reset", request="{}", accepted=True),
    ]
    logs = write_run(tmp_path, netem=[Record(CONTROL, note.at_ns, note) for note in notes])
    requested = Requested.of(_scenario({}), "forward", logs)
    assert requested.changed == ((5 * MS, 29 * MS), (51 * MS, 61 * MS))
    assert requested.varies
    instants = np.array([0, 5 * MS - 1, 5 * MS, 20 * MS, 29 * MS - 1, 29 * MS, 51 * MS, 61 * MS])
    assert requested.unchanged(instants).tolist() == [True, True, False, False, False, True, False, True]
    other = Requested.of(_scenario({}), "feedback", logs)
    assert other.changed == ()
    assert not other.varies


def test_a_trace_that_is_not_there_leaves_what_is_asked_unknown() -> None:
    requested = _requested(_scenario({"forward": {"delay": {"kind": "trace", "path": "no/such.csv"}}}))
    assert requested.base(COMMAND) is None
    assert requested.of_packets(COMMAND, _fates(np.array([5]))) is None


def test_a_message_is_cut_by_its_payload_as_the_live_link_does() -> None:
    """90 bytes and an attachment of ours are one packet of an MTU of 100, lost with probability 0.5 and not 0.75."""
    pipeline = {"loss": {"kind": "bernoulli", "p_loss": 0.5, "mtu_bytes": 100}}
    made, payload = link(forward=pipeline), bytes(90)
    fates = [offer(made, packet(k * MS, k, COMMAND, payload), k * MS) for k in range(4000)]
    share = sum(fate.outcome == "loss" for fate in fates) / len(fates)
    expected = _requested(_scenario({"forward": pipeline})).of_packets(COMMAND, _fates(np.arange(4000) * MS, 90))
    assert expected is not None
    assert share == pytest.approx(expected.p_loss.mean(), abs=0.04)
