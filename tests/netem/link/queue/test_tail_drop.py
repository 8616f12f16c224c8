import pytest

from tis.common.scenario.network import capacity
from tis.netem.link.queue.server import TailDrop


@pytest.mark.parametrize(
    ("n_packets", "n_bytes", "arriving_bytes", "admitted"),
    [
        (0, 0, 100, True),
        (0, 0, 101, False),
        (1, 60, 40, True),
        (1, 60, 41, False),
        (2, 2, 1, False),
    ],
)
def test_both_bounds_hold(n_packets: int, n_bytes: int, arriving_bytes: int, admitted: bool) -> None:
    assert TailDrop(max_packets=2, max_bytes=100).admits(n_packets, n_bytes, arriving_bytes) == admitted


def test_without_a_bound_in_bytes_only_messages_count() -> None:
    bounds = TailDrop.of(capacity.TailDrop(kind="tail_drop", max_packets=3))
    assert bounds.admits(2, 10**12, 10**12)
    assert not bounds.admits(3, 0, 0)


def test_a_codel_queue_has_the_bounds_of_its_own() -> None:
    assert TailDrop.of(capacity.CoDel(kind="codel", max_packets=7, max_bytes=9)) == (7, 9)
