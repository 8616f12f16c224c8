import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.netem.stages.delay.latency import Jitter, NormalJitter, UniformJitter

JITTERS = [NormalJitter(2e6), UniformJitter(3e6)]


@pytest.mark.parametrize("jitter", JITTERS)
@given(delay_ns=st.floats(0, 1e8), u=st.floats(1e-9, 1 - 1e-9))
def test_the_distribution_function_undoes_the_quantile_function(jitter: Jitter, delay_ns: float, u: float) -> None:
    delays_ns, us = np.array([delay_ns]), np.array([u])
    deviation_ns = jitter.quantile_ns(us, delays_ns)
    assert -delay_ns <= deviation_ns[0] <= jitter.reach_ns
    assert jitter.cdf(deviation_ns, delays_ns)[0] == pytest.approx(u, abs=1e-9)


@pytest.mark.parametrize("jitter", JITTERS)
def test_moments_beside_many_delays_are_those_of_midpoints(jitter: Jitter) -> None:
    delays_ns = np.array([0.0, 1e5, 2e6, 5e6, 4e7])
    u = (np.arange(200_000) + 0.5) / 200_000
    mean_ns, variance = jitter.moments_ns(delays_ns)
    for delay_ns, mean, spread in zip(delays_ns, mean_ns, variance, strict=True):
        deviations_ns = jitter.quantile_ns(u, np.full(len(u), delay_ns))
        assert mean == pytest.approx(deviations_ns.mean(), abs=100)
        assert spread == pytest.approx(deviations_ns.var(), rel=1e-3)


def test_a_jitter_without_spread_reaches_nowhere() -> None:
    assert NormalJitter(1e-9).reach_ns == UniformJitter(0.0).reach_ns == 0
    assert UniformJitter(0.0).cdf(np.array([-1.0, 0.0]), np.array([5.0, 5.0])).tolist() == [0, 1]
