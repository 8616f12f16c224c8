from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from tests.netem.stages.delay.laws import ADDRESS, LAWS, MS, drawn, model, stages


def _moments_by_integration(law: Any) -> tuple[float, float]:
    """Mean and variance from the survival function: E[X] = int S, E[X^2] = 2 int x S."""
    top = min(law.max_ms, float(law.whole.ppf(1 - 1e-15)) if hasattr(law.whole, "ppf") else law.max_ms)
    edges = np.unique(np.concatenate([[0, 1, 2, 3, 4, 5, 5.5, 9, 10, 15, 30, 40, top], np.geomspace(1e-6, top, 60)]))
    edges = edges[edges <= top]
    first = second = 0.0

    def survival(x: Any) -> Any:
        return 1 - law.cdf(x)

    def weighed(x: Any) -> Any:
        return 2 * x * survival(x)

    for low, high in pairwise(edges):
        first += integrate.fixed_quad(survival, low, high, n=24)[0]
        second += integrate.fixed_quad(weighed, low, high, n=24)[0]
    return first, second - first**2


@pytest.mark.parametrize("name", LAWS)
def test_moments_are_those_that_integrating_the_distribution_gives(name: str) -> None:
    law = LAWS[name]
    mean_ms, variance = _moments_by_integration(law)
    mean_ns, variance_ns2 = model(law.part).delay.moments_ns()
    assert mean_ns / MS == pytest.approx(mean_ms, rel=1e-7)
    assert variance_ns2 / MS**2 == pytest.approx(variance, rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_a_million_draws_follow_the_law(name: str) -> None:
    law = LAWS[name]
    delay_ms = drawn(stages(law.part), 1_000_000, ADDRESS._replace(key=name)) / MS
    asked = model(law.part)
    assert delay_ms.min() >= 0
    assert delay_ms.max() <= law.max_ms
    assert stats.kstest(delay_ms, law.cdf).pvalue > 0.001
    assert delay_ms.mean() == pytest.approx(asked.mean_ns / MS, rel=0.01)
    assert delay_ms.std() == pytest.approx(asked.std_ns / MS, rel=0.01)


@pytest.mark.parametrize("name", LAWS)
def test_the_quantile_function_undoes_the_distribution_function(name: str) -> None:
    law, p = LAWS[name], np.concatenate([np.geomspace(1e-6, 0.5, 40), 1 - np.geomspace(1e-9, 0.5, 40)])
    delay = model(law.part).delay
    quantiles_ns = delay.quantile_ns(p)
    np.testing.assert_allclose(law.cdf(quantiles_ns / MS), p, rtol=1e-7, atol=1e-11)
    np.testing.assert_allclose(delay.cdf(quantiles_ns), p, rtol=1e-7, atol=1e-11)
    np.testing.assert_allclose(1 - law.cdf(quantiles_ns / MS), 1 - p, rtol=1e-5)


@pytest.mark.parametrize("name", LAWS)
def test_nothing_lies_outside_the_support(name: str) -> None:
    law = LAWS[name]
    delay = model(law.part).delay
    ends_ns = delay.quantile_ns(np.array([2.0**-54, 1 - 2.0**-53]))
    assert 0 <= ends_ns[0] < ends_ns[1] <= law.max_ms * MS
    assert delay.cdf(np.array([0.0, ends_ns[0] - 1, law.max_ms * MS, 3.7e12])) == pytest.approx(
        [0, 0, 1, 1], abs=1e-9
    )


@pytest.mark.parametrize("name", ["uniform", "redrawn gamma", "lognormal", "pareto", "hyperexponential", "quantiles"])
@pytest.mark.parametrize("centre_ns", [9.07e6, 12e6])
def test_expectations_are_those_of_integrating_over_the_probability(name: str, centre_ns: float) -> None:
    delay = model(LAWS[name].part).delay

    def bump(delay_ns: Any) -> Any:  # narrow, as the effect of a small jitter is; the quantiles bend at 9 ms
        return np.exp(-(((delay_ns - centre_ns) / 2e5) ** 2))

    def at(u: float) -> float:
        return float(bump(delay.quantile_ns(np.array([u])))[0])

    places = centre_ns + np.linspace(-1.2e6, 1.2e6, 25)
    edges = np.unique(np.concatenate([[1e-12, 0.95, 1 - 1e-12], delay.cdf(places)]))
    expected = sum(integrate.quad(at, a, b, epsrel=1e-11)[0] for a, b in pairwise(edges))
    assert delay.expect(bump, places) == pytest.approx(expected, rel=1e-9, abs=1e-15)


def test_a_narrow_part_keeps_its_deviation() -> None:
    # the difference of the two moments would have lost all digits
    for kind in ("lognormal", "gamma"):
        asked = model({"kind": kind, "mean_ms": 100, "std_ms": 1e-4})
        assert asked.std_ns == pytest.approx(100, rel=1e-5)
        assert asked.mean_ns == pytest.approx(100e6, rel=1e-12)


EXTENT = st.floats(1e-6, 3.6e6)


@settings(deadline=None, max_examples=150)
@given(
    kind=st.sampled_from(["lognormal", "gamma", "pareto", "hyperexponential"]),
    mean_ms=EXTENT,
    other_ms=EXTENT,
    shape=st.floats(0.05, 1000),
    weight=st.floats(1e-12, 0.9),
    room=st.floats(0, 1),
)
def test_whatever_the_scenario_allows_gives_finite_delays_within_bounds(
    kind: str, mean_ms: float, other_ms: float, shape: float, weight: float, room: float
) -> None:
    extent_ms = mean_ms if kind != "hyperexponential" else (1 - weight) * mean_ms + weight * other_ms
    max_ms = min(3.6e6, extent_ms * 1.000001 + room * (3.6e6 - extent_ms))
    parts: dict[str, dict[str, Any]] = {
        "pareto": {"scale_ms": mean_ms, "shape": shape},
        "hyperexponential": {"weights": [1 - weight, weight], "means_ms": [mean_ms, other_ms]},
    }
    part = parts.get(kind, {"mean_ms": mean_ms, "std_ms": other_ms})
    asked = model({"kind": kind, "max_ms": max(max_ms, extent_ms), **part})
    u = np.array([2.0**-54, 1e-9, 0.1, 0.5, 0.9, 1 - 1e-9, 1 - 2.0**-53])
    delays_ns = asked.sample(u, u)
    assert (np.diff(delays_ns) >= 0).all()
    assert 0 <= delays_ns[0] <= delays_ns[-1] <= 3.6e12
    assert 0 <= asked.mean_ns <= max(max_ms, extent_ms) * MS * (1 + 1e-9)
    assert 0 <= asked.std_ns <= 3.6e12
    assert np.isfinite(asked.std_ns)
