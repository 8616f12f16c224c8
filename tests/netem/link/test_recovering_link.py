"""A link whose losses are recovered: connection, conditions, records, and agreement with the simulation."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.netem.link.test_changing_rate import driven
from tests.netem.making import KEY, link, scenario
from tis.common.records import FateBatch, ReleaseBatch
from tis.common.scenario.network import NetworkPart
from tis.netem.build import build_links
from tis.netem.expected.figures import direction_figures
from tis.netem.expected.simulate import simulate
from tis.netem.expected.synopsis import synopsis
from tis.netem.link.link import Link
from tis.netem.link.packet import Packet

MS = 1_000_000
S = 1_000 * MS
OTHER_KEY = "tis/PSM2/setpoint_cp"
END_NS = 10**15


def lossy(p_loss: float = 0.0, **stages: Any) -> dict[str, Any]:
    return {
        "delay": {"kind": "constant", "delay_ms": 10},
        "loss": {"kind": "bernoulli", "p_loss": p_loss, "recovery": {}},
        **stages,
    }


def left_ms(made: Link, arrivals: list[tuple[int, str]]) -> list[tuple[str, float]]:
    due = driven(made, [(at_ms * MS, 100, key) for at_ms, key in arrivals], END_NS)
    return [(one.name, (one.release_ns or 0) / MS) for one in due]


def test_what_an_outage_takes_arrives_after_it_by_the_doubled_timeout() -> None:
    """Sent again at 320, which is lost too, and at 760; all keys of the direction wait for it."""
    made = link(forward=lossy(), timeline=[{"at_s": 0.1, "for_s": 0.4, "set": {"outage": True}}])
    assert left_ms(made, [(50, KEY), (100, KEY), (700, OTHER_KEY), (790, KEY)]) == [
        (KEY, 60), (KEY, 770), (OTHER_KEY, 790), (KEY, 800),
    ]  # fmt: skip
    assert (made.released, sum(made.dropped.values()), made.held) == (4, 0, 0)


def test_a_repeat_in_a_stall_leaves_at_its_end() -> None:
    timeline = [
        {"at_s": 0.1, "for_s": 0.05, "set": {"outage": True}}, {"at_s": 0.3, "for_s": 0.2, "set": {"stall": True}},
    ]  # fmt: skip
    assert left_ms(link(forward=lossy(), timeline=timeline), [(100, KEY)]) == [(KEY, 510)]


def test_a_key_with_a_rule_of_its_own_is_not_on_the_connection() -> None:
    rules = [{"key": OTHER_KEY, "direction": "both", "pipeline": {}}]
    timeline = [{"at_s": 0.1, "for_s": 0.05, "set": {"add_p_loss": 1}}]
    made = link(forward=lossy(), rules=rules, timeline=timeline)
    assert left_ms(made, [(100, KEY), (160, OTHER_KEY)]) == [(OTHER_KEY, 160), (KEY, 330)]


def test_with_connections_of_their_own_keys_do_not_wait_for_each_other() -> None:
    network = {"forward": lossy(), "timeline": [{"at_s": 0.1, "for_s": 0.05, "set": {"outage": True}}]}

    def left_after(own: bool) -> list[tuple[str, float]]:
        part = NetworkPart.model_validate(network)
        made = build_links(part, ["**"], 7, None, "test", own_connections=own)["forward"]
        return left_ms(made, [(100, KEY), (160, OTHER_KEY), (200, KEY), (240, OTHER_KEY)])

    # the timeout of the first is due at 320; the acknowledgement of the third tells of it before
    assert left_after(True) == [(OTHER_KEY, 170), (KEY, 230), (KEY, 230), (OTHER_KEY, 250)]
    assert min(at_ms for _, at_ms in left_after(False)) > 170


def test_nothing_overtakes_what_waits_when_the_recovery_ends() -> None:
    change = {"loss": {"kind": "bernoulli", "p_loss": 0.0}}
    timeline = [{"at_s": 0.1, "for_s": 0.05, "set": {"outage": True}}, {"at_s": 0.15, "set": change}]
    assert left_ms(link(forward=lossy(), timeline=timeline), [(100, KEY), (200, KEY)]) == [(KEY, 230), (KEY, 230)]


def test_the_log_says_what_was_sent_again_and_how_late_it_was() -> None:
    made = link(forward=lossy(), timeline=[{"at_s": 0.1, "for_s": 0.05, "set": {"outage": True}}])
    for packet in driven(made, [(at_ms * MS, 100, KEY) for at_ms in (0, 100, 160)], END_NS):
        made.left(packet, packet.release_ns or 0)
    fates, releases = (record.data for record in made.ledger.close(S)())
    assert isinstance(fates, FateBatch)
    assert isinstance(releases, ReleaseBatch)
    assert fates.outcome == ("deliver",) * 3
    assert fates.recovered == (0, 1, 0)
    # the packet of 160 is acknowledged at 180
    assert [ns / MS for ns in releases.recovered_ns] == [0, 80, 20]


bursts: dict[str, Any] = {"kind": "burst", "p_loss": 0.1, "mean_burst": 3, "recovery": {"rto_ms": 50}}


@pytest.mark.parametrize("gap_ms", [2, 60])
def test_the_simulation_has_the_links_delays(gap_ms: int) -> None:
    parts: dict[str, Any] = {
        "forward": lossy(loss=bursts),
        "outages": [{"kind": "periodic", "every_s": 1, "for_s": 0.1}],
    }
    n = 1500
    arrivals = [(i * gap_ms * MS, 100, KEY) for i in range(n)]
    due = driven(link(**parts), arrivals, END_NS)
    many = simulate(scenario(**parts).network, "forward", 7, np.array([at for at, *_ in arrivals]), 100, key=KEY)
    assert [(one.release_ns or 0) - one.offered_ns for one in due] == many.delay_ns.tolist()
    assert many.recovered.sum() > 100
    assert not many.lost.any()


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.tuples(st.integers(0, 40), st.sampled_from([KEY, OTHER_KEY])), min_size=1, max_size=60),
    st.sampled_from([0.0, 0.2, 0.6]),
    st.integers(0, 1000),
)
def test_all_arrive_in_order_and_without_loss_as_without_recovery(
    gaps: list[tuple[int, str]], p_loss: float, seed: int
) -> None:
    now_ns, arrivals = 0, []
    for gap_ms, key in gaps:
        now_ns += gap_ms * MS
        arrivals.append((now_ns, 100, key))
    jitter = {"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 60}}

    def leaves(stages: dict[str, Any]) -> list[Packet]:
        return driven(link(seed=seed, forward=jitter | stages), arrivals, END_NS)

    found = leaves({"loss": {"kind": "bernoulli", "p_loss": p_loss, "recovery": {}}})
    plain = {one.number: one.release_ns for one in leaves({})}
    assert len(found) == len(arrivals)
    for key in (KEY, OTHER_KEY):
        seqs = [one.seq for one in found if one.name == key]
        assert seqs == sorted(seqs)
    for one in found:
        assert (one.release_ns or 0) >= (plain[one.number] or 0)
        assert p_loss > 0 or one.release_ns == plain[one.number]


def test_expected_figures_lose_nothing() -> None:
    network = NetworkPart.model_validate({"forward": lossy(0.03)})
    figures = direction_figures(network, "forward")
    assert [figures.loss_pct, figures.recovered_pct, figures.p99_ms] == pytest.approx([0, 3, 10])
    assert "3 % sent again (recovery)" in synopsis(network, {})[0]


@pytest.mark.parametrize(
    ("stages", "rule"),
    [
        ({"ordering": "reorder"}, "loss.recovery needs ordering: fifo"),
        ({"ordering": "drop_late"}, "loss.recovery needs ordering: fifo"),
        ({"rate": {"kbit_s": 100}}, "rate and loss.recovery exclude each other"),
        ({"duplicate": {"p_duplicate": 0.1}}, "duplicate and loss.recovery exclude each other"),
        ({"corrupt": {"p_corrupt": 0.1}}, "corrupt and loss.recovery exclude each other"),
    ],
)
def test_what_a_reliable_transport_does_not_do_is_refused(stages: dict[str, Any], rule: str) -> None:
    with pytest.raises(ValidationError, match=rule):
        NetworkPart.model_validate({"forward": lossy(0.1, **stages)})
    with pytest.raises(ValidationError, match=f"forward: {rule}"):
        NetworkPart.model_validate({"forward": lossy(0.1), "timeline": [{"at_s": 1, "set": stages}]})
