from collections.abc import Callable
from math import atan, cbrt, expm1
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from tests.netem.stages.delay.laws import LAWS
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.streams import Stream
from tis.netem.stages.delay import LatencyModel, latency_of
from tis.netem.stages.delay.latency import root

MS = 1e6
Floats = NDArray[np.float64]

CONSTANT_40 = {"kind": "constant", "delay_ms": 40.0}
UNIFORM_10_30 = {"kind": "uniform", "low_ms": 10.0, "high_ms": 30.0}
NORMAL_20_2 = {"kind": "normal", "mean_ms": 20.0, "std_ms": 2.0}
NORMAL_1_3 = {"kind": "normal", "mean_ms": 1.0, "std_ms": 3.0}  # 37 % of it lies below 0

# scipy's own distributions, where scipy has one for the sum of delay and jitter
CLOSED: dict[str, tuple[dict[str, Any], Any]] = {
    "uniform": ({"delay": UNIFORM_10_30}, stats.uniform(10 * MS, 20 * MS)),
    "normal": ({"delay": NORMAL_20_2}, stats.norm(20 * MS, 2 * MS)),
    "truncated normal": (
        {"delay": NORMAL_1_3},
        stats.truncnorm(-1 / 3, np.inf, loc=1 * MS, scale=3 * MS),
    ),
    "half normal": (
        {"delay": {"kind": "constant", "delay_ms": 0}, "jitter": {"kind": "normal", "std_ms": 2}},
        stats.halfnorm(scale=2 * MS),
    ),
    "constant + normal": (
        {"delay": CONSTANT_40, "jitter": {"kind": "normal", "std_ms": 3}},
        stats.norm(40 * MS, 3 * MS),
    ),
    "constant + redrawn normal": (
        {"delay": {"kind": "constant", "delay_ms": 1}, "jitter": {"kind": "normal", "std_ms": 2}},
        stats.truncnorm(-1 / 2, np.inf, loc=1 * MS, scale=2 * MS),
    ),
    "constant + redrawn uniform": (
        {"delay": {"kind": "constant", "delay_ms": 1}, "jitter": {"kind": "uniform", "half_width_ms": 4}},
        stats.uniform(0, 5 * MS),
    ),
    "uniform + uniform": (
        {"delay": UNIFORM_10_30, "jitter": {"kind": "uniform", "half_width_ms": 4}},
        stats.trapezoid(8 / 28, 20 / 28, loc=6 * MS, scale=28 * MS),
    ),
    "normal + normal": (
        {"delay": NORMAL_20_2, "jitter": {"kind": "normal", "std_ms": 1.5}},
        stats.norm(20 * MS, 2.5 * MS),
    ),
}


def _model(stages: dict[str, Any]) -> LatencyModel:
    return latency_of(Pipeline.model_validate(stages), {})


def _sample(model: LatencyModel, n: int, seed: int = 11) -> NDArray[np.int64]:
    return model.sample(Stream.named(seed, "delay").uniforms(0, n), Stream.named(seed, "jitter").uniforms(0, n))


@pytest.mark.parametrize("name", CLOSED)
def test_samples_follow_the_closed_form(name: str) -> None:
    stages, law = CLOSED[name]
    delay_ns = _sample(_model(stages), 1_000_000)
    assert delay_ns.dtype == np.int64
    assert delay_ns.min() >= 0
    assert delay_ns.mean() == pytest.approx(law.mean(), rel=0.01)
    assert delay_ns.std() == pytest.approx(law.std(), rel=0.01)
    assert stats.kstest(delay_ns[:100_000], law.cdf).pvalue > 0.001


@pytest.mark.parametrize("name", CLOSED)
def test_requested_moments_are_those_of_the_closed_form(name: str) -> None:
    stages, law = CLOSED[name]
    model = _model(stages)
    assert model.mean_ns == pytest.approx(law.mean(), rel=1e-7)
    assert model.std_ns == pytest.approx(law.std(), rel=1e-7)


@pytest.mark.parametrize("name", CLOSED)
def test_requested_quantiles_are_those_of_the_closed_form(name: str) -> None:
    stages, law = CLOSED[name]
    ps = [1e-6, 0.05, 0.5, 0.95, 0.999, 1 - 1e-6]
    assert _model(stages).quantiles_ns(ps) == pytest.approx([law.ppf(p) for p in ps], rel=1e-8, abs=0.01)


@pytest.mark.parametrize("name", CLOSED)
def test_shares_are_about_the_quantiles_of_the_closed_form(name: str) -> None:
    stages, law = CLOSED[name]
    found = _model(stages).shares_ns(400)
    assert (np.diff(found) >= 0).all()
    assert law.cdf(found) == pytest.approx((np.arange(400) + 0.5) / 400, abs=0.003)


def _redrawn(delay: Callable[[int], Floats], jitter: Callable[[int], Floats], n: int) -> Floats:
    """Draw as the scenario says: a delay until it is not negative, then jitter until the sum is not."""
    delays = delay(n)
    while (bad := delays < 0).any():
        delays[bad] = delay(int(bad.sum()))
    deviations = jitter(n)
    while (bad := delays + deviations < 0).any():
        deviations[bad] = jitter(int(bad.sum()))
    return delays + deviations


@pytest.mark.parametrize("delay_kind", ["uniform", "normal"])
@pytest.mark.parametrize("jitter_kind", ["uniform", "normal"])
def test_coupled_delay_and_jitter_follow_a_loop_that_redraws(delay_kind: str, jitter_kind: str) -> None:
    rng = np.random.default_rng(5)
    delays: dict[str, tuple[dict[str, Any], Callable[[int], Floats]]] = {
        "uniform": ({"kind": "uniform", "low_ms": 0, "high_ms": 6}, lambda n: rng.uniform(0, 6 * MS, n)),
        "normal": (NORMAL_1_3, lambda n: rng.normal(1 * MS, 3 * MS, n)),
    }
    jitters: dict[str, tuple[dict[str, Any], Callable[[int], Floats]]] = {
        "uniform": (
            {"kind": "uniform", "half_width_ms": 4},
            lambda n: rng.uniform(-4 * MS, 4 * MS, n),
        ),
        "normal": ({"kind": "normal", "std_ms": 2.5}, lambda n: rng.normal(0, 2.5 * MS, n)),
    }
    delay_part, draw_delay = delays[delay_kind]
    jitter_part, draw_jitter = jitters[jitter_kind]
    model = _model({"delay": delay_part, "jitter": jitter_part})
    expected = _redrawn(draw_delay, draw_jitter, 300_000)
    ours = _sample(model, 300_000)
    assert stats.ks_2samp(ours[:100_000], expected[:100_000]).pvalue > 0.001
    assert ours.mean() == pytest.approx(expected.mean(), rel=0.01)
    assert model.mean_ns == pytest.approx(expected.mean(), rel=0.01)
    assert model.std_ns == pytest.approx(expected.std(), rel=0.01)
    for p, quantile_ns in zip((0.1, 0.5, 0.9), model.quantiles_ns((0.1, 0.5, 0.9)), strict=True):
        assert (expected <= quantile_ns).mean() == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / len(expected)))


@pytest.mark.parametrize("name", ["lognormal", "redrawn gamma", "endless pareto", "hyperexponential", "quantiles"])
@pytest.mark.parametrize("jitter", [{"kind": "normal", "std_ms": 2}, {"kind": "uniform", "half_width_ms": 7}])
def test_what_is_asked_for_is_what_is_drawn(name: str, jitter: dict[str, Any]) -> None:
    model = _model({"delay": LAWS[name].part, "jitter": jitter})
    n = 200_000
    delay_ns = _sample(model, n)
    assert model.mean_ns == pytest.approx(delay_ns.mean(), abs=4 * model.std_ns / np.sqrt(n))
    assert model.std_ns == pytest.approx(delay_ns.std(), rel=0.02)
    ps = (0.001, 0.1, 0.5, 0.9, 0.999)
    for p, quantile_ns in zip(ps, model.quantiles_ns(ps), strict=True):
        assert (delay_ns <= quantile_ns).mean() == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / n)), p


def test_exponential_and_normal_sum_to_the_closed_form() -> None:
    # a shift of 30 leaves room for every deviation, so the sum is exponentially modified normal
    model = _model(
        {
            "delay": {"kind": "gamma", "mean_ms": 6, "std_ms": 6, "shift_ms": 30},
            "jitter": {"kind": "normal", "std_ms": 2},
        }
    )
    law = stats.exponnorm(3, 30 * MS, 2 * MS)
    ps = [1e-5, 0.01, 0.5, 0.99, 0.99999]
    assert model.quantiles_ns(ps) == pytest.approx([law.ppf(p) for p in ps], rel=1e-8)
    assert model.mean_ns == pytest.approx(36 * MS, rel=1e-12)
    assert model.std_ns == pytest.approx(np.sqrt(40) * MS, rel=1e-9)


def test_a_jitter_far_narrower_than_the_delay_is_resolved() -> None:
    # where the density is 1 / (100 ms) on both sides of x, the sum's distribution function is the delay's own
    model = _model(
        {"delay": {"kind": "uniform", "low_ms": 0, "high_ms": 100}, "jitter": {"kind": "normal", "std_ms": 1e-3}}
    )
    assert model.quantiles_ns([0.25, 0.9]) == pytest.approx([25 * MS, 90 * MS], abs=0.02)


def test_requested_moments_where_only_some_deviations_are_redrawn() -> None:
    # delay U[0, 6], deviation U[max(-4, -d), 4] ms: given d < 4 the sum is U[0, 4 + d], else U[d - 4, d + 4], so
    # mean = (1/6) (int_0^4 (4 + d) / 2 dd + int_4^6 d dd) = 11/3
    # mean square = (1/6) (int_0^4 (4 + d)^2 / 3 dd + int_4^6 d^2 + 16/3 dd) = (1/6) (448/9 + 152/3 + 32/3) = 500/27
    model = _model(
        {
            "delay": {"kind": "uniform", "low_ms": 0, "high_ms": 6},
            "jitter": {"kind": "uniform", "half_width_ms": 4},
        }
    )
    assert model.mean_ns / MS == pytest.approx(11 / 3, rel=1e-9)
    assert model.std_ns / MS == pytest.approx(np.sqrt(500 / 27 - 121 / 9), rel=1e-9)


@pytest.mark.parametrize(
    ("stages", "expected_ns"),
    [
        ({}, 0),
        ({"delay": CONSTANT_40}, 40_000_000),
        ({"delay": {"kind": "constant", "delay_ms": 1.4e-6}}, 1),
        ({"delay": {"kind": "constant", "delay_ms": 1.6e-6}}, 2),
        ({"delay": {"kind": "uniform", "low_ms": 3, "high_ms": 3}}, 3_000_000),
        ({"delay": {"kind": "normal", "mean_ms": 7, "std_ms": 0}}, 7_000_000),
        ({"delay": {"kind": "normal", "mean_ms": 0, "std_ms": 0}}, 0),
        ({"delay": CONSTANT_40, "jitter": {"kind": "normal", "std_ms": 0}}, 40_000_000),
        ({"delay": CONSTANT_40, "jitter": {"kind": "uniform", "half_width_ms": 0}}, 40_000_000),
        ({"delay": CONSTANT_40, "jitter": {"kind": "normal", "std_ms": 1e-320}}, 40_000_000),
        ({"delay": {"kind": "normal", "mean_ms": 7, "std_ms": 1e-320}}, 7_000_000),
    ],
)
def test_distributions_without_spread_are_exact(stages: dict[str, Any], expected_ns: int) -> None:
    model = _model(stages)
    assert set(_sample(model, 5000).tolist()) == {expected_ns}
    assert model.mean_ns == pytest.approx(expected_ns, abs=0.5)
    assert model.std_ns == 0


def test_outermost_uniforms_stay_where_the_distribution_is() -> None:
    u = np.array([2.0**-54, 0.5, 1 - 2.0**-53])
    delay_ms = _model({"delay": {"kind": "normal", "mean_ms": 100, "std_ms": 1}}).sample(u, u) / MS
    # the quantile of 2^-54 is at -8.29 standard deviations, that of 1 - 2^-53 at 8.21 (tables of erfc)
    np.testing.assert_allclose(delay_ms, [91.71, 100.0, 108.21], atol=0.01)


@settings(deadline=None, max_examples=60)
@given(
    mean_ms=st.floats(0, 100),
    std_ms=st.floats(0, 100),
    jitter_ms=st.floats(0, 100),
    kind=st.sampled_from(["normal", "uniform"]),
    u=st.lists(st.floats(2.0**-54, 1 - 2.0**-53), min_size=2, max_size=20),
)
def test_delays_rise_with_each_uniform_and_are_never_negative(
    mean_ms: float, std_ms: float, jitter_ms: float, kind: str, u: list[float]
) -> None:
    field = "std_ms" if kind == "normal" else "half_width_ms"
    model = _model(
        {
            "delay": {"kind": "normal", "mean_ms": mean_ms, "std_ms": std_ms},
            "jitter": {"kind": kind, field: jitter_ms},
        }
    )
    rising = np.sort(np.array(u))
    fixed = np.full(len(u), 0.3)
    for delay_ns in (model.sample(fixed, rising), _model({"delay": NORMAL_1_3}).sample(rising, fixed)):
        assert delay_ns.min() >= 0
        assert (np.diff(delay_ns) >= 0).all()


@pytest.mark.parametrize(
    ("f", "expected"),
    [
        (lambda x: x - 3.5, 3.5),
        (lambda x: cbrt(x - 2), 2.0),
        (lambda x: atan(1e6 * (x - 7.25)), 7.25),
        (lambda x: expm1(50 * (x - 9)), 9.0),
        (lambda x: -1.0 if x < 6.5 else 1.0, 6.5),
        (lambda x: (x - 9) ** 9, 9.0),  # false position alone crawls
        (lambda x: x - 10.0, 10.0),
        (lambda x: x, 0.0),
    ],
)
def test_the_crossing_is_found_in_few_steps(f: Callable[[float], float], expected: float) -> None:
    calls = []

    def counted(x: float) -> float:
        calls.append(x)
        return f(x)

    assert root(counted, 0.0, 10.0, 1e-9) == pytest.approx(expected, abs=1e-9)
    assert len(calls) < 120
    assert all(0 <= x <= 10 for x in calls)
