import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.common.clocks.wrong_clock import S, WrongClock, exchanges
from tis.common.clocks import SHARED, ClockModel, Envelope, fit_clock

KNOTS = st.lists(st.tuples(st.integers(0, 1000), st.integers(-500, 500)), min_size=1, max_size=12)


@given(KNOTS, st.lists(st.integers(-300, 1300), min_size=1, max_size=10), st.sampled_from([0.0, 0.125, 1.0]))
@settings(max_examples=150)
def test_the_tightest_limit_is_the_least_over_all_knots(
    knots: list[tuple[int, int]], instants: list[int], rate: float
) -> None:
    """Against the minimum over every knot of its limit and the way from it."""
    knots.sort(key=lambda knot: knot[0])
    at_ns, limit_ns = np.array(knots, dtype=np.int64).T
    envelope = Envelope.tightest(at_ns, limit_ns.astype(float), rate)
    expected = [min(limit + rate * abs(ns - at) for at, limit in knots) for ns in instants]
    assert np.allclose(envelope.limit_at(np.array(instants)), expected, rtol=0, atol=1e-6)


def test_the_reference_itself_is_exact() -> None:
    ns = np.array([-5, 0, 10**15])
    assert SHARED.shared
    assert SHARED.to_reference_ns(ns) is ns
    assert SHARED.from_reference_ns(ns) is ns
    assert SHARED.uncertainty_ns(ns).tolist() == [0, 0, 0]


def test_to_the_reference_and_back() -> None:
    clock = WrongClock(-7 * S, -80)
    model = fit_clock(exchanges(clock.shows, 40, S, 100_000, seed=7))
    own_ns = np.arange(-10 * S, 100 * S, S)
    assert np.abs(model.from_reference_ns(model.to_reference_ns(own_ns)) - own_ns).max() <= 1
    assert np.array_equal(model.uncertainty_at_ns(model.to_reference_ns(own_ns)), model.uncertainty_ns(own_ns))


def test_a_limit_on_either_side_bounds_the_error() -> None:
    """Above the line by 10 at most and below it by 4: 10, and one for the rounding."""
    above, below = (Envelope(np.array([0]), np.array([limit]), 1e-6) for limit in (10.0, 4.0))
    model = ClockModel(0, 100.0, 0.0, 0.0, above, below)
    assert model.uncertainty_ns(np.array([0])).tolist() == [11]
    assert model.to_reference_ns(np.array([0])).tolist() == [100]
