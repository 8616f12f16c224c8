import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tests.netem.stages.loss.making import lomax_pmf
from tis.netem.stages.loss.pareto_runs import MAX_RUN, FlooredLomax

GRID = (np.arange(4_000) + 0.5) / 4_000  # every quantile once: no random numbers, no noise


@given(shape=st.floats(3.5, 50), scale=st.floats(0.001, 20))
def test_mean_is_the_sum_over_the_probabilities(shape: float, scale: float) -> None:
    pmf = lomax_pmf(shape, scale, 200_000)
    assert FlooredLomax(shape, scale).mean == pytest.approx(pmf @ np.arange(len(pmf)), rel=1e-6)


def test_quantiles_are_those_of_scipy() -> None:
    drawn = FlooredLomax(3.2, 7.0).quantiles(GRID)
    assert (drawn == np.floor(stats.lomax(3.2, scale=7.0).isf(GRID))).all()


def test_a_draw_beyond_all_bounds_is_cut() -> None:
    assert FlooredLomax(1.001, 1e6).quantiles(np.array([2.0**-54, 0.5])).tolist() == [MAX_RUN, 998_615]


@pytest.mark.parametrize(("shape", "scale"), [(2.5, 6.0), (1.2, 3.0), (30.0, 0.5)])
def test_residual_runs_follow_the_equilibrium_law(shape: float, scale: float) -> None:
    law = FlooredLomax(shape, scale)
    rest = np.array([law.residual(u) for u in GRID])
    # a run of 1 + K packets is seen at each of them alike: P(R = r) = P(K >= r - 1) / E[1 + K]
    wanted = (1 + np.arange(30) / scale) ** -shape / (1 + law.mean)
    got = np.bincount(rest, minlength=31)[1:31] / len(GRID)
    assert got == pytest.approx(wanted, abs=1.01 / len(GRID))


@pytest.mark.parametrize(("shape", "scale"), [(2.5, 6.0), (1.2, 3.0), (30.0, 0.5)])
def test_a_packet_lies_in_a_long_cycle_more_often(shape: float, scale: float) -> None:
    law = FlooredLomax(shape, scale)
    drawn = np.array([law.length_biased(u) for u in GRID])
    wanted = lomax_pmf(shape, scale, 31)[:30] * np.arange(1, 31) / (1 + law.mean)
    got = np.bincount(drawn, minlength=30)[:30] / len(GRID)
    assert got == pytest.approx(wanted, abs=1.01 / len(GRID))
