from tests.nodes import Metronome, Shelf
from tis.common.runtime.clock import VirtualClock
from tis.common.runtime.loop import Seat, VirtualBus, run
from tis.common.zenoh_syntax import key_matches


def _run(nodes: list[Metronome], until_ns: int) -> None:
    clock = VirtualClock()
    run([Seat(node, Shelf()) for node in nodes], VirtualBus(nodes, clock), clock, until_ns)


def test_every_tick_before_the_end_happens_at_its_instant() -> None:
    node = Metronome("a", period_ns=10, n_ticks=100)
    _run([node], until_ns=45)
    assert node.woken_ns == [0, 10, 20, 30, 40]
    assert node.finished_ns == 45


def test_a_tick_due_at_the_very_end_no_longer_happens() -> None:
    node = Metronome("a", period_ns=10, n_ticks=100)
    _run([node], until_ns=20)
    assert node.woken_ns == [0, 10]


def test_messages_arrive_when_they_are_sent_and_before_ticks_of_that_instant() -> None:
    order: list[str] = []

    class Listener(Metronome):
        def receive(self, arrival):  # type: ignore[no-untyped-def]
            order.append(f"heard {arrival.payload.decode()} at {arrival.recv_ns}")
            return []

        def wake(self, now_ns):  # type: ignore[no-untyped-def]
            order.append(f"tick at {now_ns}")
            self.k += 1
            return []

    sender = Metronome("sender", period_ns=10, n_ticks=2)
    listener = Listener("listener", period_ns=10, n_ticks=2, listening=[("west", "t/**")])
    _run([sender, listener], until_ns=15)
    assert order == ["heard 0 at 0", "tick at 0", "heard 1 at 10", "tick at 10"]


def test_a_node_does_not_hear_itself_nor_the_other_network() -> None:
    west = Metronome("w", 10, 1, listening=[("west", "**")])
    east = Metronome("e", 10, 1, listening=[("east", "**")], network="east")
    _run([west, east], until_ns=20)
    assert west.heard == []
    assert east.heard == []


def test_a_stopped_loop_still_lets_nodes_finish() -> None:
    node = Metronome("a", period_ns=10, n_ticks=100)
    clock = VirtualClock()
    run([Seat(node, Shelf())], VirtualBus([node], clock), clock, 1000, stopped=lambda: node.k == 3)
    assert node.woken_ns == [0, 10, 20]
    assert node.finished_ns == 20


def test_double_stars_match_any_chunks_but_control_chunks() -> None:
    assert key_matches("**", "tis/MTML/measured_cp")
    assert key_matches("tis/**", "tis")
    assert key_matches("tis/**/measured_cp", "tis/MTML/measured_cp")
    assert not key_matches("**", "tis/@tis/epoch")
    assert key_matches("tis/@tis/**", "tis/@tis/epoch")
    assert not key_matches("tis/MTML/measured_cp", "tis/MTML/measured_cp/x")
