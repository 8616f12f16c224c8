"""Pairing and conversion on literal stamps: an oracle that writes down when everything truly happened."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.common.clocks.wrong_clock import WrongClock, exchange, exchanges
from tis.common.clocks import Exchanges, fit_clock
from tis.deploy.net.probe import FOREIGN, WARMING_UP, last_received, pair

MS = 1_000_000
S = 1_000_000_000
WHOLE_S = 1000


def _ints(*values: int) -> np.ndarray:
    return np.array(values, dtype=np.int64)


def test_on_one_clock_a_delay_is_a_difference_and_exact() -> None:
    sent_ns, marks = _ints(100, 200, 300, 400), _ints(7, 8, 9, 10)
    heard = [(WARMING_UP, 0, 90), (0, 7, 150), (2, 9, 310), (1, 8, 320), (2, 9, 330), (FOREIGN, 0, 340)]
    paired = pair(sent_ns, marks, heard, timeout_ns=1000)
    assert paired.delay_ns.tolist() == [50, 120, 10, -1]
    assert paired.uncertainty_ns.tolist() == [0, 0, 0, 0]
    assert (paired.n_duplicates, paired.n_late, paired.n_foreign, paired.n_impossible) == (1, 0, 1, 0)


def test_what_comes_too_late_or_with_another_mark_is_lost() -> None:
    heard = [(0, 6, 110), (1, 8, 1201), (5, 1, 120)]  # somebody else's 0, ours too late, and one never sent
    paired = pair(_ints(100, 200), _ints(7, 8), heard, timeout_ns=1000)
    assert paired.delay_ns.tolist() == [-1, -1]
    assert (paired.n_duplicates, paired.n_late, paired.n_foreign) == (0, 1, 2)


def test_nothing_heard_is_all_lost_and_nothing_sent_is_nothing() -> None:
    assert pair(_ints(1, 2), _ints(0, 0), [], 10).delay_ns.tolist() == [-1, -1]
    assert len(pair(_ints(), _ints(), [(0, 0, 5)], 10).delay_ns) == 0


def test_three_seconds_and_fifty_ppm_apart_over_an_unequal_path() -> None:
    """There takes 9 ms, back 1 ms: the delay comes out as 5 ms, and the bound says that it may be 9."""
    clock = WrongClock(offset_ns=3 * S, drift_ppm=50.0)
    compared = Exchanges.of(exchange(clock.shows, (4 + i) * S, 9 * MS, 20_000, 1 * MS) for i in range(WHOLE_S))
    model = fit_clock(compared)
    left_ns = 4 * S + np.arange(WHOLE_S, dtype=np.int64) * S
    took_ns = np.full(len(left_ns), 9 * MS) + np.arange(len(left_ns)) % 7 * MS
    sent_ns, marks = clock.shows(left_ns), np.arange(len(left_ns))
    heard = [(i, i, int(ns)) for i, ns in enumerate(left_ns + took_ns)]
    paired = pair(sent_ns, marks, heard, 5 * S, model)
    np.testing.assert_allclose(paired.delay_ns, took_ns - 4 * MS, atol=2000)
    assert (abs(paired.delay_ns - took_ns) <= paired.uncertainty_ns).all()
    assert 4 * MS < paired.uncertainty_ns.max() < 5.1 * MS  # half the round trip, and what the drift may be
    assert paired.n_impossible == 0


@settings(max_examples=30, deadline=None)
@given(
    offset_ms=st.integers(-10_000, 10_000),
    drift_ppm=st.floats(-80, 80),
    there_share=st.floats(0, 1),
    took_ms=st.lists(st.floats(0.1, 40), min_size=1, max_size=20),
    seed=st.integers(0, 99),
)
def test_the_true_delay_lies_within_the_uncertainty(
    offset_ms: int, drift_ppm: float, there_share: float, took_ms: list[float], seed: int
) -> None:
    clock = WrongClock(offset_ms * MS, drift_ppm)
    begin_ns = 20 * S
    model = fit_clock(exchanges(clock.shows, 30, S // 2, 8 * MS, seed, there_share, begin_ns))
    took_ns = np.array([round(ms * MS) for ms in took_ms], dtype=np.int64)
    left_ns = begin_ns + np.arange(len(took_ns), dtype=np.int64) * S // 2
    heard = sorted(((i, i, int(ns)) for i, ns in enumerate(left_ns + took_ns)), key=lambda row: row[2])
    paired = pair(clock.shows(left_ns), np.arange(len(took_ns)), heard, 5 * S, model)
    assert (paired.delay_ns >= 0).all()
    assert (abs(paired.delay_ns - took_ns) <= paired.uncertainty_ns + 2).all()
    assert paired.n_impossible == 0


def test_a_clock_that_was_set_meanwhile_is_noticed() -> None:
    """The receiver's clock was put back by a second, after the exchanges."""
    clock = WrongClock(offset_ns=3 * S, drift_ppm=0.0)
    model = fit_clock(Exchanges.of(exchange(clock.shows, (4 + i) * S, MS, 20_000, MS) for i in range(5)))
    sent_ns = clock.shows([9 * S])
    paired = pair(sent_ns, _ints(0), [(0, 0, 8 * S)], 5 * S, model)
    assert paired.delay_ns.tolist() == [0]
    assert paired.n_impossible == 1


def test_what_is_known_of_a_far_end_that_is_gone_ends_with_the_last_heard() -> None:
    marks = _ints(5, 6, 7, 8)
    assert last_received(marks, [(0, 5, 1), (2, 7, 3), (1, 6, 4), (3, 99, 5), (WARMING_UP, 0, 6)]) == 3
    assert last_received(marks, [(FOREIGN, 0, 1)]) == 0
