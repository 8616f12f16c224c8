"""The congestion window: literal windows by the formulas of RFC 5681, 6937 and 9438, and what waits for it."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.stages.loss.test_recovery import MS, TERMS, Offer, due_ms
from tis.netem.stages.loss.congestion import OPEN, Congestion, Window
from tis.netem.stages.loss.recovery import Terms

CUBIC, RENO = TERMS._replace(congestion="cubic"), TERMS._replace(congestion="reno")
FULL = 1448


def acknowledged(window: Window, n: int, at_ms: int = 0, used: bool = True) -> int:
    """Return the window after one packet each of ``n`` was delivered in order."""
    for _ in range(n):
        window.used(window.size if used else 0, 0, 1, 0)
        window.delivered(1, 0, True, False, at_ms * MS, 100 * MS)
    return window.size


def after_loss(kind: Congestion, size: int) -> Window:
    """Return a window that a loss has reduced from ``size``."""
    window = Window(kind)
    acknowledged(window, size - window.size)
    window.reduce()
    window.end()
    return window


def test_it_doubles_in_each_round_trip_as_long_as_it_is_used() -> None:
    window = Window("cubic")
    assert (acknowledged(window, 10), acknowledged(window, 20)) == (20, 40)
    assert acknowledged(window, 50, used=False) == 40


@pytest.mark.parametrize(("kind", "left"), [("reno", 50), ("cubic", 70)])
def test_a_loss_takes_half_of_it_or_three_tenths(kind: Congestion, left: int) -> None:
    assert after_loss(kind, 100).size == left


def test_reno_grows_by_one_in_each_round_trip() -> None:
    window = after_loss("reno", 40)
    assert [acknowledged(window, 20), acknowledged(window, 21), acknowledged(window, 21)] == [21, 22, 22]


def test_cubic_is_where_it_was_after_k_seconds() -> None:
    """K = cbrt(100 * 0.3 / 0.4) = 4.2 s; before it grows fast, then slowly, and beyond it fast again."""
    window = after_loss("cubic", 100)
    sizes = [acknowledged(window, 10, at_ms) for at_ms in range(0, 8000, 10)]
    assert sizes[420] == pytest.approx(100, abs=2)
    assert sizes[210] == pytest.approx(100 - 0.4 * 2.1**3, abs=2)
    assert sizes[-1] == pytest.approx(100 + 0.4 * 3.8**3, abs=2)


def test_a_recovery_sends_in_the_share_that_shall_be_left() -> None:
    """Reno, 20 under way and one lost: of 19 acknowledgements the first repeats it, then each second sends one.

    At the 17th there are ten under way, which is what shall be left.
    """
    window = Window("reno")
    acknowledged(window, 10)
    window.reduce()
    pipe, sent = 19, []
    for n in range(1, 19):
        pipe -= 1
        window.delivered(1, pipe, False, n == 1, 0, 0)
        if window.size > pipe:
            window.left(window.size - pipe)
            pipe = window.size
            sent.append(n)
    assert sent == [1, 3, 5, 7, 9, 11, 13, 15, 18]
    window.end()
    assert window.size == 10


def test_a_timeout_leaves_one_packet_and_starts_slowly_again() -> None:
    window = Window("reno")
    acknowledged(window, 30)
    window.timed_out(0, is_new=True)
    assert window.size == 1
    assert (acknowledged(window, 1), acknowledged(window, 18), acknowledged(window, 20)) == (2, 20, 21)


def test_a_window_of_none_opens_after_what_follows_a_timeout() -> None:
    window = Window("none")
    window.reduce()
    window.end()
    window.timed_out(2, is_new=True)
    assert acknowledged(window, 4) == 7
    window.end()
    assert window.size == OPEN


def test_what_the_window_holds_back_leaves_with_the_acknowledgements() -> None:
    """Of 34 full packets, ten leave at once, 20 at 20 ms, the rest at 40."""
    assert due_ms([Offer(0, n_bytes=FULL)] * 34, CUBIC) == [10] * 10 + [30] * 20 + [50] * 4


def test_short_messages_that_wait_leave_in_full_packets() -> None:
    """Ten leave alone; five of 289 bytes fill a packet but for 3, into which the next begins."""
    found = due_ms([Offer(0, n_bytes=FULL)] * 10 + [Offer(0, n_bytes=289)] * 100, CUBIC)
    assert found == [10] * 10 + [30] * 100


def test_a_packet_of_many_is_lost_by_the_fate_of_its_first() -> None:
    made = [Offer(0, n_bytes=FULL)] * 10 + [Offer(0, int(n in (0, 7)), n_bytes=144) for n in range(20)]
    assert due_ms(made, CUBIC)[10:] == [55] * 20  # 20 + 20 + 5 + 10, as in RACK


def test_a_long_message_is_sent_in_pieces() -> None:
    assert due_ms([Offer(0, n_bytes=31 * FULL)], CUBIC) == [50]
    assert due_ms([Offer(0, n_bytes=30 * FULL), Offer(0)], RENO) == [30, 50]


offers = st.lists(
    st.tuples(st.integers(0, 40), st.sampled_from([0] * 9 + [1, 3]), st.integers(0, 30), st.integers(0, 20_000)),
    min_size=1,
    max_size=80,
)


@settings(deadline=None, max_examples=100)
@given(offers, st.sampled_from([CUBIC, RENO]))
def test_nothing_is_lost_or_early_and_two_senders_agree(drawn: list[tuple[int, int, int, int]], terms: Terms) -> None:
    at_ms, made = 0, []
    for gap_ms, n_lost, delay_ms, n_bytes in drawn:
        at_ms += gap_ms
        made.append(Offer(at_ms, n_lost, delay_ms, n_bytes))
    found = due_ms(made, terms)
    assert all(due >= one.at_ms + one.delay_ms for one, due in zip(made, found, strict=True))
    assert found == due_ms(made, terms)
