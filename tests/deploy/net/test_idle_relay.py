"""An idle relay on this machine: its delays are counted, and vary."""

import pytest

from tests.common.runtime.live_zenoh import soon
from tis.deploy.net.idle_relay import open_idle_relay


@pytest.mark.live
def test_it_tells_how_far_apart_delays_lie_once_enough_came() -> None:
    with open_idle_relay() as idle:
        assert idle is not None
        assert soon(lambda: idle.spread() is not None)
        idle.stop()
        spread = idle.spread()
    assert spread is not None
    assert 0 < spread.most_ns <= spread.nearly_all_ns <= spread.all_ns
