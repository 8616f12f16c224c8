"""The bound on a buffer is one on memory: what the held messages take is what the link accounts for."""

import gc
from pathlib import Path

import pytest

from tests.common.runtime.live_zenoh import settle, soon
from tests.netem.bridge.live_bridge import Bridged, a_bridge, delays
from tis.netem.bridge.bridge import Put

pytestmark = pytest.mark.live

_PAGE_BYTES = 4096


def resident_bytes() -> int:
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE_BYTES


def hold(there: Bridged, n: int, n_bytes: int) -> None:
    """Let the bridge hold ``n`` more messages; one at a time, so that each has come in a buffer of its own."""
    link = there.bridge.links["forward"]
    before = link.held
    for i in range(n):
        there.west.put("demo/a", bytes(n_bytes), attachment=bytes(20))
        assert soon(lambda upto=before + i + 1: link.held >= upto)  # type: ignore[misc]


@pytest.mark.parametrize("n_bytes", [16, 4096])
def test_held_messages_take_the_memory_that_is_accounted_for(n_bytes: int) -> None:
    with a_bridge(**delays(50_000.0)) as there:
        settle(there.west)
        link = there.bridge.links["forward"]
        hold(there, 200, n_bytes)
        begun, accounted = resident_bytes(), link.held_bytes
        hold(there, 1000, n_bytes)
        took, accounted = resident_bytes() - begun, link.held_bytes - accounted
        assert accounted == 1000 * (n_bytes + 20 + 1000)
        # pages of the process that are not the messages'; 9.4 kB each before they were copied
        assert took <= 2 * accounted
        kept = [held.item for _, _, held in link._heap]
        assert all(isinstance(one, Put) and isinstance(one.payload, bytes) for one in kept)
