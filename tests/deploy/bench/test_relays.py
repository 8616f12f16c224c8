import pytest

from tis.common.runtime.ports import free_endpoints
from tis.deploy.bench.relays import least_relay
from tis.deploy.bench.traffic import paced


@pytest.mark.live
def test_the_least_relay_carries_messages_and_delays_each() -> None:
    west, east = free_endpoints()
    with least_relay(west, east) as relay:
        n_sent, delays_us = paced([west], [east], 1, 200, 0.5, 16)
    assert len(delays_us) > 0.8 * n_sent  # a busy machine may drop some
    assert delays_us.min() > 1000  # drawn around 5 ms
    assert relay.figures["n"] >= len(delays_us)
    assert relay.figures["release_error_us"]["p50"] >= 0
