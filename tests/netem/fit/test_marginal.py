"""Samples of known distributions, by scipy.stats, are told apart and their parameters found again."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats

from tis.common.scenario.network.delay import Delay
from tis.netem.fit.marginal import MarginalName, fit_marginal

N = 40_000
LAWS: dict[str, tuple[Any, dict[str, Any]]] = {
    "uniform": (stats.uniform(10, 5), {"low_ms": 10, "high_ms": 15}),
    "normal": (stats.norm(40, 3), {"mean_ms": 40, "std_ms": 3}),
    "lognormal": (stats.lognorm(0.5, loc=20, scale=10), {"shift_ms": 20, "mean_ms": 11.331, "std_ms": 6.039}),
    "gamma": (stats.gamma(4, loc=20, scale=2), {"shift_ms": 20, "mean_ms": 8, "std_ms": 4}),
    "pareto": (stats.lomax(3.5, loc=10, scale=20), {"shift_ms": 10, "scale_ms": 20, "shape": 3.5}),
}


def sample(name: str, n: int = N) -> np.ndarray:
    law, _ = LAWS[name]
    delay_ms: np.ndarray = law.rvs(n, random_state=np.random.default_rng(3))
    return np.rint(delay_ms * 1e6).astype(np.int64)


@pytest.mark.parametrize("name", LAWS)
def test_the_family_and_its_parameters_are_found(name: str) -> None:
    found = fit_marginal(sample(name), N)
    assert found.chosen == name
    for parameter, value in LAWS[name][1].items():
        assert found.stage[parameter] == pytest.approx(value, rel=0.06), parameter
    TypeAdapter(Delay).validate_python(found.stage)


@pytest.mark.parametrize("delay_ms", [0.1, 21.9, 33.333333])
def test_equal_delays_are_a_constant_and_of_no_family(delay_ms: float) -> None:
    found = fit_marginal(np.full(200, round(delay_ms * 1e6)), 200)
    assert [one.name for one in found.candidates] == ["constant"]
    assert found.stage == {"kind": "constant", "delay_ms": pytest.approx(delay_ms)}


def test_a_mixture_of_exponentials_is_found() -> None:
    rng = np.random.default_rng(4)
    ms = 15 + np.where(rng.random(N) < 0.8, rng.exponential(10, N), rng.exponential(150, N))
    found = fit_marginal(np.rint(ms * 1e6).astype(np.int64), N)
    assert found.chosen == "hyperexponential"
    assert found.stage["shift_ms"] == pytest.approx(15, rel=0.01)
    assert found.stage["weights"] == pytest.approx([0.8, 0.2], rel=0.05)
    assert found.stage["means_ms"] == pytest.approx([10, 150], rel=0.05)
    assert sum(found.stage["weights"]) == pytest.approx(1, abs=1e-9)
    TypeAdapter(Delay).validate_python(found.stage)


def test_an_exponential_is_a_gamma_of_equal_mean_and_deviation() -> None:
    rng = np.random.default_rng(5)
    found = fit_marginal(np.rint(15e6 + rng.exponential(10e6, N)).astype(np.int64), N)
    assert found.chosen == "exponential"
    assert found.stage["kind"] == "gamma"
    assert found.stage["std_ms"] == found.stage["mean_ms"] == pytest.approx(10, rel=0.02)
    assert found.stage["shift_ms"] == pytest.approx(15, rel=0.001)


def test_what_no_family_describes_becomes_quantiles() -> None:
    rng = np.random.default_rng(6)
    ms = np.where(rng.random(N) < 0.5, rng.normal(20, 1, N), rng.normal(40, 1, N))
    found = fit_marginal(np.rint(ms * 1e6).astype(np.int64), N)
    assert found.chosen == "quantiles"
    assert min(candidate.ks for candidate in found.candidates if candidate.bic is not None) > found.ks_bound
    TypeAdapter(Delay).validate_python(found.stage)


def test_few_independent_delays_allow_a_family_that_many_refuse() -> None:
    """A logistic distribution is nearly normal: 0.023 off."""
    delay_ns = np.rint(stats.logistic(50, 2).ppf((np.arange(N) + 0.5) / N) * 1e6).astype(np.int64)
    strict, loose = (fit_marginal(delay_ns, n_independent) for n_independent in (1e9, 1000))
    assert 0.01 < strict.ks_bound < strict.candidates[0].ks < loose.ks_bound == 0.03
    assert strict.chosen == "quantiles"
    assert loose.chosen == strict.candidates[0].name


def test_however_correlated_the_fit_stays_near_the_record() -> None:
    delay_ns = np.concatenate([sample("gamma"), sample("normal", N // 2)])
    assert fit_marginal(delay_ns, n_independent=5).chosen == "quantiles"


def test_a_constant_is_the_median() -> None:
    found = fit_marginal(np.array([5_000_000] * 6 + [5_100_000, 90_000_000]), 8, wanted="constant")
    assert found.stage == {"kind": "constant", "delay_ms": 5.0}


@pytest.mark.parametrize("name", ["uniform", "gamma", "quantiles", "constant"])
def test_a_distribution_that_is_wanted_is_taken(name: MarginalName) -> None:
    assert fit_marginal(sample("lognormal"), N, wanted=name).stage["kind"] == name


def test_a_distribution_that_is_wanted_but_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="a gamma distribution cannot be fitted"):
        fit_marginal(np.array([5_000_000] * 300), 300, wanted="gamma")


def test_two_delays_are_enough_to_give_an_answer() -> None:
    TypeAdapter(Delay).validate_python(fit_marginal(np.array([1_000_000, 9_000_000]), 2).stage)
