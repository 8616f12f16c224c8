"""Closed flows: nobody's fates change, a flow that returns goes on where it was, and memory is bounded."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import link, offer, packet
from tis.netem.link import flows as flows_module
from tis.netem.link.flows import IDLE_NS, Flows
from tis.netem.link.link import Link
from tis.netem.link.packet import Fate, Flow

S = 1_000_000_000
STAGES: dict[str, Any] = {
    "delay": {"kind": "normal", "mean_ms": 20, "std_ms": 6},
    "loss": {"kind": "burst", "p_loss": 0.2, "mean_burst": 3},
    "duplicate": {"p_duplicate": 0.2},
    "ordering": "fifo",
}
SHIFT = [{"at_s": 30, "for_s": 40, "set": {"ordering": "drop_late", "add_delay_ms": 5}}]
Packet = tuple[str, int, int | None]  # key, instant, sequence number in our header


def _fates(made: Link, packets: list[Packet]) -> tuple[list[Fate], list[tuple[Any, ...]]]:
    fates, left = [], []
    for key, at_ns, seq in packets:
        left += [(one.name, one.seq, one.copy_index, one.release_ns, one.departure) for one in made.release(at_ns)]
        fates.append(offer(made, packet(at_ns, seq, key), at_ns))
    left += [
        (one.name, one.seq, one.copy_index, one.release_ns, one.departure) for one in made.release(packets[-1][1] + S)
    ]
    return fates, left


def _churning(n: int, gap_ns: int) -> list[Packet]:
    """One packet each of ``n`` names that never return, and packets of three that do: now and then, or all along."""
    found: list[Packet] = []
    for i in range(n):
        at_ns = i * gap_ns
        found.append((f"tis/fleet/{i}", at_ns, None))
        found.append(("tis/always", at_ns, None))
        if i % 97 == 0:
            found += [("tis/seldom", at_ns, None), ("tis/numbered", at_ns, i)]
    return found


def test_closing_changes_nobodys_fates_and_a_flow_that_returns_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    packets = _churning(600, S // 2)
    closing = link(forward=STAGES, timeline=SHIFT)
    with monkeypatch.context() as endless:
        endless.setattr(flows_module, "IDLE_NS", 10**6 * S)
        keeping = link(forward=STAGES, timeline=SHIFT)
        expected = _fates(keeping, packets)
    assert _fates(closing, packets) == expected
    assert len(keeping.flows.open) == 603
    assert len(closing.flows.open) < 100
    assert _fates(link(forward=STAGES, timeline=SHIFT), packets) == expected  # and so it is when it is replayed


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.tuples(st.sampled_from([f"tis/{i}" for i in range(8)]), st.integers(0, 40_000_000), st.booleans())),
    st.sampled_from(["fifo", "reorder", "drop_late"]),
)
def test_a_link_with_room_for_three_names_decides_as_one_without_a_bound(
    steps: list[tuple[str, int, bool]], ordering: str
) -> None:
    packets: list[Packet] = []
    now_ns = 0
    for i, (key, gap_ns, foreign) in enumerate(steps):
        now_ns += gap_ns
        packets.append((key, now_ns, None if foreign else i))
    if not packets:
        return
    stages = STAGES | {"ordering": ordering, "rate": {"kbit_s": 50}}
    expected = _fates(link(forward=stages), packets)
    with pytest.MonkeyPatch.context() as few:
        few.setattr(flows_module, "MAX_FLOWS", 3)
        assert _fates(link(forward=stages), packets) == expected


def test_what_holds_packets_stays_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flows_module, "MAX_FLOWS", 10)
    made = link(forward={"delay": {"kind": "constant", "delay_ms": 100}})
    for i in range(50):
        assert offer(made, packet(0, None, f"tis/{i}"), 0).outcome == "deliver"  # none is refused
    assert len(made.flows.open) == 50
    for i in range(50, 100):
        made.release(S)
        assert offer(made, packet(S, None, f"tis/{i}"), S + i * S).outcome == "deliver"
    assert len(made.flows.open) <= 11


def test_a_packet_in_the_short_cut_opens_its_flow_again() -> None:
    """Another thread may open a name between `lets_through` and `crossed`."""
    made = link()
    offer(made, packet(0, None, "tis/a"), 0)
    made.release(0)
    assert made.lets_through("tis/a", 10, 30 * S)
    for i in range(3):
        offer(made, packet(0, None, f"tis/{i}"), (60 + 30 * i) * S)
        made.release((60 + 30 * i) * S)
    assert "tis/a" not in made.flows.open
    made.crossed("tis/a", b"", 10, 120 * S, 120 * S)
    assert offer(made, packet(0, None, "tis/a"), 120 * S).seq == 2


def _used(flows: Flows, name: str, n_packets: int, now_ns: int) -> int:
    """Open a flow, count packets, and return the number of the first one."""
    flow = Flow(name, None, "")
    flows.add(flow, now_ns)
    first = flow.n_unnumbered
    flow.n_unnumbered += n_packets
    return first


def test_beyond_the_bound_of_closed_names_new_ones_begin_above_all_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flows_module, "MAX_CLOSED", 50)
    flows = Flows()
    firsts = [_used(flows, f"{i}", 7 if i == 3 else 2, i * IDLE_NS) for i in range(40)]
    assert firsts == [0] * 40
    assert flows.counters() == {}
    later = [_used(flows, f"{i}", 2, i * IDLE_NS) for i in range(40, 70)]
    assert later[0] == 0
    assert later[-1] == 7
    assert flows.counters()["gone_names"] > 50
    assert _used(flows, "3", 1, 100 * IDLE_NS) >= 7  # no number comes twice
    for i in range(4):
        _used(flows, f"other {i}", 1, (102 + 2 * i) * IDLE_NS)
    assert "69" not in flows.open
    assert _used(flows, "69", 1, 120 * IDLE_NS) == 9


def test_a_link_with_few_names_closes_none() -> None:
    made = link(forward=STAGES)
    for i in range(400):
        offer(made, packet(i * S, None, f"tis/{i % 5}"), i * S)
        made.release(i * S)
    assert len(made.flows.open) == 5
    assert made.flows.n_gone == 0
