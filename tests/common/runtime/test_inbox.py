import threading

from tis.common.runtime.clock import VirtualClock
from tis.common.runtime.zenoh_bus import Inbox


def _inbox() -> tuple[Inbox[str], VirtualClock]:
    inbox: Inbox[str] = Inbox()
    clock = VirtualClock()
    inbox.start(clock)
    return inbox, clock


def test_arrivals_come_in_order_with_their_stamps() -> None:
    inbox, clock = _inbox()
    receive = inbox.receiver("east")
    for at_ns in (5, 7, 7):
        clock.advance(at_ns)
        receive(f"at {at_ns}")
    got = [inbox.wait(10) for _ in range(3)]
    stamps = [(s.recv_ns, s.item, s.network) for s in got if s]
    assert stamps == [(5, "at 5", "east"), (7, "at 7", "east"), (7, "at 7", "east")]


def test_an_arrival_after_the_deadline_stays_for_the_next_wait() -> None:
    inbox, clock = _inbox()
    clock.advance(11)
    inbox.receiver("east")("late")
    assert inbox.wait(10) is None
    late = inbox.wait(12)
    assert late is not None
    assert late.recv_ns == 11


def test_after_a_drain_no_arrival_is_stamped_at_or_before_the_watermark() -> None:
    inbox, clock = _inbox()
    clock.advance(3)
    late = threading.Timer(0, lambda: None)
    late.start()
    late.join()
    # The loop woke for a deadline at 10 and the virtual clock still shows 3, as a coarse clock might.
    inbox.receiver("east")("before")
    assert inbox.wait(10) is not None
    clock.advance(10)
    assert inbox.wait(10) is None
    clock._now_ns = 9
    inbox.receiver("east")("squeezed in")
    squeezed = inbox.wait(20)
    assert squeezed is not None
    assert squeezed.recv_ns == 11


def test_what_comes_before_the_epoch_is_counted_and_dropped() -> None:
    inbox: Inbox[str] = Inbox()
    inbox.receiver("west")("too early")
    clock = VirtualClock()
    clock._now_ns = -5
    inbox.start(clock)
    inbox.receiver("west")("still too early")
    clock._now_ns = 0
    assert inbox.wait(0) is None
    assert inbox.n_early == 2


def test_an_alarm_ends_the_wait_early() -> None:
    inbox, _ = _inbox()
    threading.Timer(0.02, inbox.alarm).start()
    assert inbox.wait(60_000_000_000) is None


def test_a_failing_clock_is_remembered_instead_of_swallowed() -> None:
    class Broken:
        def now_ns(self) -> int:
            raise RuntimeError("no time")

    inbox: Inbox[str] = Inbox()
    inbox.start(Broken())
    inbox.receiver("east")("x")
    assert isinstance(inbox.error, RuntimeError)


def test_of_a_bounded_subscription_no_more_than_its_share_waits() -> None:
    inbox, clock = _inbox()
    clock.advance(5)
    flood, other = inbox.receiver("west", limit=3), inbox.receiver("west")
    for i in range(1000):
        flood(f"flood {i}")
    other("ours")
    assert [s.item for s in (inbox.wait(10) for _ in range(4)) if s] == ["flood 0", "flood 1", "flood 2", "ours"]
    assert inbox.n_flooded == 997
    flood("later")
    later = inbox.wait(10)
    assert later is not None
    assert later.item == "later"
