from fractions import Fraction
from math import ceil

from hypothesis import given
from hypothesis import strategies as st

from tis.netem.link.queue.transmission import Line

RATES = st.sampled_from([0.001, 0.3, 7.0, 56.0, 1544.0, 8000.0, 12345.678, 1e6, 1e9])
BYTES = st.integers(0, 70_000)


def test_a_byte_at_8_kbit_s_takes_a_millisecond() -> None:
    line = Line(8)
    assert line.send(1, 5) == 1_000_005
    assert line.send(2, 5) == 3_000_005  # waits for the first
    assert line.send(1, 3_000_006) == 4_000_006  # the line was idle for 1 ns


def test_thirds_of_a_nanosecond_are_carried_on() -> None:
    line = Line(24_000_000)  # a byte takes 1/3 ns
    assert [line.send(1, 0) for _ in range(7)] == [1, 1, 1, 2, 2, 2, 3]
    # the line is free at 7/3 ns; what is there at 3 ns begins then, and not before
    assert [line.send(1, 3) for _ in range(3)] == [4, 4, 4]


def test_the_rate_is_the_decimal_number_that_was_written() -> None:
    assert Line(0.3).send(3, 0) == 80_000_000  # the binary fraction nearest to 0.3 is a little less


def _changed(line: Line, kbit_s: float, now_ns: int) -> Line:
    """Return a line at another rate that goes on with what is left."""
    after = Line(kbit_s)
    after.resume(line.left(now_ns), now_ns)
    return after


@given(RATES, st.lists(BYTES, max_size=60), st.integers(0, 10**15))
def test_messages_in_a_row_take_exactly_the_time_of_their_bytes(kbit_s: float, sizes: list[int], at_ns: int) -> None:
    line = Line(kbit_s)
    for i, n_bytes in enumerate(sizes):
        exact_ns = at_ns + sum(sizes[: i + 1]) * Fraction(8_000_000) / Fraction(str(kbit_s))
        assert line.send(n_bytes, at_ns) == max(ceil(exact_ns), at_ns)


@given(RATES, RATES, st.integers(1, 70_000), st.fractions(0, 1))
def test_what_is_left_goes_at_the_new_rate(before: float, after: float, n_bytes: int, share: Fraction) -> None:
    line = Line(before)
    end_ns = n_bytes * Fraction(8_000_000) / Fraction(str(before))
    line.send(n_bytes, 0)
    now_ns = int(end_ns * share)
    line = _changed(line, after, now_ns)
    left_ns = (end_ns - now_ns) * Fraction(str(before)) / Fraction(str(after))
    assert 0 <= line.free_ns - (now_ns + left_ns) < 2  # to whole ns once, and the rest to parts of one
    assert line.send(0, now_ns) == line.free_ns


def test_an_idle_line_changes_its_rate_at_once() -> None:
    line = Line(8)
    line.send(1, 0)
    line = _changed(line, 80, 1_000_000)
    assert line.send(1, 1_000_000) == 1_100_000
    line = Line(24_000_000)
    line.send(1, 0)  # free at 1/3 ns
    line = _changed(line, 8, 1)
    assert line.send(1, 0) == 1_000_001
