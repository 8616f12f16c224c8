from typing import Any

import numpy as np
import pytest

from tests.netem.making import link, offer, packet, scenario
from tis.common.scenario.network import NetworkPart
from tis.deploy.net.profiles import find_profile
from tis.netem.expected.figures import DirectionFigures, direction_figures
from tis.netem.expected.simulate import IN_ORDER_HZ, in_order, simulate

MS = 1_000_000
NOISY: dict[str, Any] = {
    "loss": {"kind": "burst", "p_loss": 0.1, "mean_burst": 3},
    "delay": {"kind": "gamma", "mean_ms": 20, "std_ms": 5},
    "correlation": {"half_life_s": 0.2},
    "duplicate": {"p_duplicate": 0.05},
    "corrupt": {"p_corrupt": 0.05},
    "ordering": "reorder",
}
CHANGING: dict[str, Any] = {
    "outages": [{"kind": "poisson", "mean_gap_s": 1, "mean_s": 0.2}],
    "states": {
        "kind": "markov",
        "states": [
            {"name": "good", "mean_s": 1, "next": [{"to": "bad"}]},
            {
                "name": "bad",
                "mean_s": 0.5,
                "next": [{"to": "good"}],
                "forward": {"add_p_loss": 0.3, "scale_delay": 2},
            },
        ],
    },
    "timeline": [{"at_s": 2, "for_s": 2, "ramp_s": 0.5, "set": {"add_delay_ms": 50}}],
}


@pytest.mark.parametrize("parts", [{}, CHANGING])
def test_many_at_once_as_the_link_packet_by_packet(parts: dict[str, Any]) -> None:
    n = 4_500
    offered_ns = np.arange(n, dtype=np.int64) * MS + 300
    key = "tis/MTML/measured_cp"
    many = simulate(scenario(forward=NOISY, **parts).network, "forward", 7, offered_ns, 7 + 20, key=key)
    made = link(forward=NOISY, **parts)
    fates = [offer(made, packet(int(at), seq, key), int(at)) for seq, at in enumerate(offered_ns)]
    assert [fate.outcome != "deliver" for fate in fates] == many.lost.tolist()
    assert [fate.outcome == "outage" for fate in fates] == many.outage.tolist()
    assert [fate.delay_ns for fate in fates] == many.delay_ns.tolist()
    assert [fate.n_copies for fate in fates] == ((many.copy_delay_ns >= 0) & ~many.lost).tolist()
    assert many.outage.any() == bool(parts)


def test_all_lost_in_a_run_long_outage() -> None:
    network = scenario(forward=NOISY, timeline=[{"at_s": 0, "set": {"outage": True}}]).network
    many = simulate(network, "forward", 1, np.arange(10, dtype=np.int64) * MS)
    assert many.lost.all()
    assert many.outage.all()


def _in_order(network: NetworkPart) -> DirectionFigures:
    return in_order(network, "forward", direction_figures(network, "forward"))


def test_a_late_packet_holds_back_those_behind_it() -> None:
    """Against the distribution function: a packet arrives by x if each one before it would have."""
    network = find_profile("wifi_bad").network
    points = np.array([(one.p, one.delay_ms) for one in network.forward.delay.points])  # type: ignore[union-attr]
    x_ms = np.linspace(0, points[-1, 1], 20_001)
    later_ms = 1000 / IN_ORDER_HZ * np.arange(16)
    # of equal delays the last point counts: one in three has none
    by_ms = np.interp(x_ms[:, None] + later_ms, points[1:, 1], points[1:, 0]).prod(axis=1)
    found = _in_order(network)
    assert found.p50_ms == pytest.approx(x_ms[np.searchsorted(by_ms, 0.5)], rel=0.05)
    assert found.p99_ms == pytest.approx(x_ms[np.searchsorted(by_ms, 0.99)], rel=0.02)
    assert found.mean_ms == pytest.approx(np.trapezoid(1 - by_ms, x_ms), rel=0.05)
    assert found.p50_ms > 2 * direction_figures(network, "forward").p50_ms
    assert found == _in_order(network), "it is deterministic"


@pytest.mark.parametrize("name", ["lte_netfi", "lindbergh_2001", "midband_5g_sa_3g7"])
def test_without_a_packet_that_waits_the_delays_are_those_drawn(name: str) -> None:
    network = find_profile(name).network
    assert _in_order(network) == pytest.approx(direction_figures(network, "forward"), rel=1e-3)


def test_the_late_that_are_dropped_have_no_delay() -> None:
    delay = {"kind": "uniform", "low_ms": 0, "high_ms": 100}
    drop, wait = (
        NetworkPart.model_validate({"forward": {"delay": delay, "ordering": ordering}})
        for ordering in ("drop_late", "fifo")
    )
    assert _in_order(drop).mean_ms < 40 < 50 < 60 < _in_order(wait).mean_ms
