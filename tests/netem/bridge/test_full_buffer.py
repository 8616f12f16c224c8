"""A full buffer is said once a direction, with the bound that was met."""

import pytest

from tests.netem.making import KEY, link, offer, packet
from tis.common.scenario.network import Buffer
from tis.netem.bridge.watches import BufferWatch, LengthWatch

MS = 1_000_000
SLOW = {"delay": {"kind": "constant", "delay_ms": 1000}}


@pytest.mark.parametrize(
    ("buffer", "words"),
    [
        ({"max_packets": 3}, "buffer of 3 messages full"),
        ({"max_packets": 3, "policy": "drop_oldest"}, "buffer of 3 messages full"),
        ({"max_mb": 0.0005}, "buffer of 0.0005 MB full"),
    ],
)
def test_the_first_message_that_a_full_buffer_drops_is_said_once(buffer: dict[str, object], words: str) -> None:
    part = Buffer.model_validate(buffer)
    made, said = link(forward=SLOW, buffer=buffer), list[str]()
    watch = BufferWatch({"forward": made}, part, said.append)
    for k in range(10):
        offer(made, packet(k * MS, k, KEY, bytes(100)), k * MS)
        watch.look()
        assert bool(said) == (made.dropped["overflow"] + made.dropped["evicted"] > 0)
    assert said == [
        f"forward (west to east): {words}: it drops messages, which is not part of the configured network"
    ]


def test_what_loss_and_queues_drop_is_not_said() -> None:
    made, said = link(forward={"rate": {"kbit_s": 1, "queue": {"kind": "tail_drop", "max_packets": 1}}}), list[str]()
    for k in range(10):
        offer(made, packet(k * MS, k, KEY, bytes(100)), k * MS)
    BufferWatch({"forward": made}, Buffer(), said.append).look()
    assert made.dropped["queue_full"] == 9
    assert said == []


@pytest.mark.parametrize(("n_bytes", "is_said"), [(60, False), (61, True)])
def test_a_message_longer_than_its_queue_is_said_once(n_bytes: int, is_said: bool) -> None:
    """A queue of 100 bytes takes 60 and 40 of overhead; one byte more never passes. A full queue is not said."""
    queue = {"kind": "tail_drop", "max_bytes": 100}
    made, said = link(forward={"rate": {"kbit_s": 8, "overhead_bytes": 40, "queue": queue}}), list[str]()
    watch = LengthWatch({"forward": made}, said.append)
    for k in range(3):
        made.offer(KEY, b"", n_bytes, k * MS, "message")
        watch.look()
    assert made.dropped["queue_full"] == (3 if is_said else 2)
    assert said == is_said * [
        "forward (west to east): a message is longer than its queue's max_bytes: such messages never pass"
    ]
