from typing import Any

import numpy as np
import pytest

from tests.netem.making import link, offer, packet, scenario
from tis.netem.expected.simulate import simulate

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
