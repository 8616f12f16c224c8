"""What pipelines ask for, against long draws of the very models that decide."""

import numpy as np
import pytest

from tis.common.scenario.network import NetworkPart
from tis.common.trace import Trace
from tis.deploy.report.subjects.network.requested_pipeline import requested_pipeline
from tis.netem.expected.simulate import simulate

N = 200_000
TRACE = Trace("t", np.arange(5) * 10_000_000, np.array([4_000_000, 8_000_000, -1, 6_000_000, 2_000_000]))


def _asked(pipeline: dict[str, object], n: int = N) -> tuple[dict[str, float | None], np.ndarray, float]:
    network = NetworkPart.model_validate({"forward": pipeline})
    asked = requested_pipeline(network.forward, {"t.csv": TRACE})
    assert asked is not None
    drawn = simulate(network, "forward", 5, np.arange(n) * 1_000_000, traces={"t.csv": TRACE})
    return asked.delay_ms(), drawn.delay_ns[~drawn.lost] / 1e6, asked.skewness


@pytest.mark.parametrize(
    "pipeline",
    [
        {"delay": {"kind": "uniform", "low_ms": 10, "high_ms": 30}, "jitter": {"kind": "normal", "std_ms": 3}},
        {"delay": {"kind": "lognormal", "shift_ms": 5, "mean_ms": 10, "std_ms": 8}},
        {"delay": {"kind": "gamma", "mean_ms": 4, "std_ms": 4}, "ordering": "reorder", "reorder": {"p_reorder": 0.3}},
    ],
)
def test_moments_and_quantiles_are_those_of_long_draws(pipeline: dict[str, object]) -> None:
    asked, drawn_ms, skewness = _asked(pipeline)
    assert asked["mean"] == pytest.approx(drawn_ms.mean(), rel=0.01)
    assert asked["std"] == pytest.approx(drawn_ms.std(), rel=0.02)
    for p in (50, 90, 95, 99):
        assert asked[f"p{p}"] == pytest.approx(np.quantile(drawn_ms, p / 100), rel=0.02), p
    assert asked["p99.9"] == pytest.approx(np.quantile(drawn_ms, 0.999), rel=0.06)
    spread = (drawn_ms - drawn_ms.mean()) / drawn_ms.std()
    assert skewness == pytest.approx((spread**3).mean(), rel=0.15, abs=0.05)


def test_messages_that_skip_a_part_of_their_delay_have_moments_and_no_quantiles() -> None:
    asked, drawn_ms, _ = _asked(
        {
            "delay": {"kind": "uniform", "low_ms": 0, "high_ms": 20},
            "ordering": "reorder",
            "reorder": {"p_reorder": 0.5, "early_ms": 5},
        }
    )
    assert asked["mean"] == pytest.approx(drawn_ms.mean(), rel=0.01)
    assert asked["std"] == pytest.approx(drawn_ms.std(), rel=0.01)
    assert asked["p50"] is None


def test_a_lowest_share_without_delay_are_the_lowest_quantiles() -> None:
    pipeline = {"delay": {"kind": "constant", "delay_ms": 9}, "ordering": "reorder", "reorder": {"p_reorder": 0.6}}
    network = NetworkPart.model_validate({"forward": pipeline})
    asked = requested_pipeline(network.forward, {})
    assert asked is not None
    assert asked.quantiles_ms([0.5, 0.6, 0.61]) == [0, 0, 9]


def test_a_trace_asks_for_its_rows_and_nothing_when_it_is_missing() -> None:
    part = {"kind": "trace", "path": "t.csv"}
    network = NetworkPart.model_validate({"forward": {"delay": part, "loss": part}})
    asked = requested_pipeline(network.forward, {"t.csv": TRACE})
    assert asked is not None
    assert asked.delay_ms()["mean"] == pytest.approx(5)
    assert asked.loss().p_loss == pytest.approx(0.2)
    assert asked.is_recorded
    assert requested_pipeline(network.forward, {}) is None


def test_no_delay_is_asked_for_as_zero() -> None:
    asked, drawn_ms, skewness = _asked({}, n=10)
    assert set(asked.values()) == {0.0, None}
    assert skewness == 0
    assert drawn_ms.max() == 0
