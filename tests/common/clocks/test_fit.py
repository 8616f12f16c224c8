import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.common.clocks.wrong_clock import MS, Ints, S, WrongClock, exchanges
from tis.common.clocks import UNKNOWN_DRIFT_PPM, WANDER_PPM, Exchanges, fit_clock

REFERENCE_NS = np.linspace(3 * S, 63 * S, 500).astype(np.int64)


def test_3_s_and_50_ppm_come_back_within_the_stated_uncertainty() -> None:
    """A minute of exchanges over a way there three times as long as the way back: biased, and the bound knows it."""
    clock = WrongClock(3 * S, 50)
    model = fit_clock(exchanges(clock.shows, 240, S // 4, 120_000, seed=1, asymmetry=0.75))
    own_ns = clock.shows(REFERENCE_NS)
    error_ns = model.to_reference_ns(own_ns) - REFERENCE_NS
    uncertainty_ns = model.uncertainty_ns(own_ns)
    assert (np.abs(error_ns) <= uncertainty_ns).all()
    assert 0 < uncertainty_ns.max() < 150_000
    assert abs(error_ns).max() > 10_000  # the asymmetry is really there
    assert model.drift == pytest.approx(50e-6, abs=model.drift_bound)
    assert model.drift_bound < 5e-6
    assert not model.shared


@given(
    offset_ns=st.integers(-(10**12), 10**12),
    drift_ppm=st.floats(-90, 90),
    asymmetry=st.floats(0, 1),
    n=st.integers(1, 60),
    every_ns=st.integers(MS, S),
    seed=st.integers(0, 2**32),
)
@settings(max_examples=80, deadline=None)
def test_every_stamp_comes_back_within_its_uncertainty(
    offset_ns: int, drift_ppm: float, asymmetry: float, n: int, every_ns: int, seed: int
) -> None:
    """Whatever the offset, the drift, the asymmetry and the number of exchanges, also before and after them."""
    clock = WrongClock(offset_ns, drift_ppm)
    model = fit_clock(exchanges(clock.shows, n, every_ns, 200_000, seed, asymmetry))
    reference_ns = np.linspace(2 * S, 70 * S, 100).astype(np.int64)
    own_ns = clock.shows(reference_ns)
    assert (np.abs(model.to_reference_ns(own_ns) - reference_ns) <= model.uncertainty_ns(own_ns)).all()


@given(seed=st.integers(0, 2**32), wander_ppm=st.floats(0, WANDER_PPM))
@settings(max_examples=40, deadline=None)
def test_a_clock_whose_rate_wanders_stays_within_the_uncertainty(seed: int, wander_ppm: float) -> None:
    """The rate swings by up to the frequency tolerance of RFC 5905, slowly: no line fits."""

    def shows(reference_ns: object) -> Ints:
        ns = np.asarray(reference_ns, dtype=np.float64)
        period_ns = 40 * S
        swing_ns = wander_ppm * 1e-6 * period_ns / (2 * np.pi) * np.sin(2 * np.pi * ns / period_ns)
        return np.rint(ns - S - swing_ns).astype(np.int64)

    model = fit_clock(exchanges(shows, 120, S // 2, 100_000, seed))
    own_ns = shows(REFERENCE_NS)
    assert (np.abs(model.to_reference_ns(own_ns) - REFERENCE_NS) <= model.uncertainty_ns(own_ns)).all()


def test_a_clock_that_is_slewed_makes_its_uncertainty_larger() -> None:
    """200 ppm for 20 s of a minute, as a time service corrects 4 ms: far above the tolerance, and found out."""

    def shows(reference_ns: object) -> Ints:
        ns = np.asarray(reference_ns, dtype=np.float64)
        return np.rint(ns - 200e-6 * np.clip(ns - 20 * S, 0, 20 * S)).astype(np.int64)

    model = fit_clock(exchanges(shows, 240, S // 4, 50_000, seed=3))
    own_ns = shows(REFERENCE_NS)
    uncertainty_ns = model.uncertainty_ns(own_ns)
    assert (np.abs(model.to_reference_ns(own_ns) - REFERENCE_NS) <= uncertainty_ns).all()
    assert uncertainty_ns.max() > 300_000


def test_a_drift_that_cannot_be_known_yet_is_not_used() -> None:
    """Twenty exchanges in 20 ms say nothing of a drift; 100 ppm are allowed for, which 10 s later is 1 ms."""
    clock = WrongClock(0, 90)
    model = fit_clock(exchanges(clock.shows, 20, MS, 100_000, seed=4))
    assert model.drift == 0
    assert model.drift_bound == UNKNOWN_DRIFT_PPM * 1e-6
    later_ns = np.array([13 * S])
    uncertainty_ns = int(model.uncertainty_ns(clock.shows(later_ns))[0])
    assert abs(int(model.to_reference_ns(clock.shows(later_ns))[0]) - 13 * S) <= uncertainty_ns
    assert 10 * 115_000 < uncertainty_ns < 10 * 115_000 + 500_000


def test_one_exchange_makes_a_model_and_none_does_not() -> None:
    model = fit_clock(Exchanges.of([(0, 1050, 1050, 100)]))
    assert model.to_reference_ns(np.array([50])).tolist() == [1050]
    assert model.uncertainty_ns(np.array([50])).tolist() == [52]  # half the round trip, the wander, the rounding
    with pytest.raises(ValueError, match="never compared"):
        fit_clock(Exchanges.of([]))


def test_a_step_of_the_clock_ends_in_a_wide_bound_and_not_in_a_loop() -> None:
    before, after = [(i * S, i * S, i * S, i * S + 10) for i in range(5)], 7 * S
    stepped = [(i * S, i * S + after, i * S + after, i * S + 10) for i in range(5, 10)]
    model = fit_clock(Exchanges.of(before + stepped))
    own_ns = np.arange(10) * S
    reference_ns = own_ns + np.where(own_ns < 5 * S, 0, after)
    assert (np.abs(model.to_reference_ns(own_ns) - reference_ns) <= model.uncertainty_ns(own_ns)).all()
