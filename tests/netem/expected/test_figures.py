"""The figures of the library against long simulations, and what a network that never answers shows."""

from math import isnan
from typing import Any

import numpy as np
import pytest

from tis.common.scenario.network import NetworkPart
from tis.deploy.net.profiles import find_profile
from tis.netem.expected.figures import direction_figures
from tis.netem.expected.simulate import simulate


def simulated(network: NetworkPart, rate_hz: float, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    fates = simulate(network, "forward", 3, (np.arange(n) * 1e9 / rate_hz).astype(np.int64))
    return fates.delay_ns[~fates.lost] / 1e6, fates.lost, fates.outage


STATES = {
    "kind": "markov",
    "states": [
        {"name": "good", "mean_s": 2, "next": [{"to": "bad"}]},
        {
            "name": "bad",
            "mean_s": 1,
            "next": [{"to": "good", "weight": 3}, {"to": "gone"}],
            "forward": {"scale_delay": 2, "add_delay_ms": 5, "add_p_loss": 0.3},
        },
        {"name": "gone", "mean_s": 0.5, "next": [{"to": "good"}], "forward": {"outage": True}},
    ],
}
NETWORKS: dict[str, dict[str, Any]] = {
    "states": {"forward": {"delay": {"kind": "uniform", "low_ms": 10, "high_ms": 30}}, "states": STATES},
    "jitter": {
        "forward": {
            "loss": {"kind": "burst", "p_loss": 0.1, "mean_burst": 3},
            "delay": {"kind": "uniform", "low_ms": 1, "high_ms": 3},
            "jitter": {"kind": "normal", "std_ms": 1},
        }
    },
    # one exact quantile of this sum takes a quarter of a second, and the mixture has 64 laws
    "jitter, states and steps": {
        "forward": {
            "delay": {"kind": "gamma", "shift_ms": 5, "mean_ms": 10, "std_ms": 5},
            "jitter": {"kind": "normal", "std_ms": 2},
        },
        "states": STATES,
        "steps": [{"every_s": 1, "direction": "forward", "delay": {"kind": "uniform", "low_ms": 0, "high_ms": 60}}],
    },
    "outages": {"outages": [{"kind": "periodic", "every_s": 4, "for_s": 1}]},
}


@pytest.mark.parametrize("name", NETWORKS)
def test_the_figures_are_those_of_a_long_simulation(name: str) -> None:
    network = NetworkPart.model_validate(NETWORKS[name])
    of = direction_figures(network, "forward")
    delay_ms, lost, outage = simulated(network, 20, 200_000)
    assert of.mean_ms == pytest.approx(delay_ms.mean(), rel=0.02)
    assert of.std_ms == pytest.approx(delay_ms.std(), rel=0.02)
    assert of.p50_ms == pytest.approx(np.percentile(delay_ms, 50), rel=0.03)
    assert of.p99_ms == pytest.approx(np.percentile(delay_ms, 99), rel=0.02)
    assert of.loss_pct == pytest.approx(100 * lost[~outage].mean(), rel=0.05)
    assert of.outage_pct == pytest.approx(100 * outage.mean(), rel=0.05)


def test_the_burst_is_unknown_where_it_depends_on_the_rate() -> None:
    assert direction_figures(NetworkPart.model_validate(NETWORKS["states"]), "forward").mean_burst is None
    assert direction_figures(NetworkPart.model_validate(NETWORKS["jitter"]), "forward").mean_burst == pytest.approx(3)


def test_a_link_that_is_out_for_ever_has_no_delay() -> None:
    states = {"kind": "cycle", "states": [{"name": "out", "for_s": 1, "forward": {"outage": True}}]}
    of = direction_figures(NetworkPart.model_validate({"states": states}), "forward")
    assert isnan(of.mean_ms)
    assert of.outage_pct == 100


def test_the_cycle_of_satellites_shows_in_the_tail() -> None:
    network = find_profile("starlink_2022_eu").network
    of = direction_figures(network, "forward")
    calm = network.model_copy(update={"states": None})
    share = (0.14 * 70 + 0.075 * 37.5) / 15
    assert of.mean_ms == pytest.approx(direction_figures(calm, "forward").mean_ms + share, rel=1e-4)
    assert of.p99_ms > direction_figures(calm, "forward").p99_ms + 20
