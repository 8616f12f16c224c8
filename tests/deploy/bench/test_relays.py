import pytest

from common.runtime.free_endpoints import free_endpoints
from deploy.bench.relays import least_relay
from deploy.bench.traffic import paced


@pytest.mark.live
def test_the_least_relay_carries_every_message_and_delays_each() -> None:
    west, east = free_endpoints()
    with least_relay(west, east) as relay:
        n_sent, delays_us = paced([west], [east], 1, 200, 0.5, 16)
    assert len(delays_us) == n_sent
    assert delays_us.min() > 1000  # drawn around 5 ms
    n_first = 1  # of the key, which is not measured
    assert relay.figures["n"] == n_sent + n_first
    assert relay.figures["release_error_us"]["p50"] >= 0
