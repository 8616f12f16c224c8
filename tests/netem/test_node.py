from collections.abc import Sequence
from typing import Any

from tests.netem.making import KEY, packet, scenario
from tis.common.channels import Network
from tis.common.messages import Header, encode
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.records import FateBatch, ReleaseBatch
from tis.netem.build import build_netem
from tis.netem.node import NetemNode

MS = 1_000_000
COMMAND = KEY
ESTIMATE = "tis/PSM2/estimated_cp"


def _node(**network: Any) -> NetemNode:
    return build_netem(scenario(**network))


def _forty_and_fifteen() -> NetemNode:
    return _node(
        forward={"delay": {"kind": "constant", "delay_ms": 40}},
        feedback={"delay": {"kind": "constant", "delay_ms": 15}},
    )


def _emissions(outputs: Sequence[Output]) -> list[Emission]:
    return [output for output in outputs if isinstance(output, Emission)]


def _batches(records: Sequence[Output], topic: str) -> list[Any]:
    found = [record for record in records if isinstance(record, Record) and record.topic == topic]
    return [record.data for record in found]


def test_wants_every_key_of_both_networks() -> None:
    assert list(_node().listens()) == [("west", "**"), ("east", "**")]
    assert _node().name == "netem"


def test_two_packets_cross_in_opposite_directions() -> None:
    node = _forty_and_fifteen()
    out = packet(1_000, seq=3)
    back = packet(2_000, seq=9, key=ESTIMATE, payload=b"estimate", network="east")
    assert node.receive(out) == []
    assert node.next_wake_ns() == 40_001_000
    assert node.receive(back) == []
    assert node.next_wake_ns() == 15_002_000

    assert node.wake(15_001_999) == []
    (emission,) = _emissions(node.wake(15_002_000))
    assert (emission.network, emission.key, emission.payload) == ("west", ESTIMATE, b"estimate")
    assert emission.attachment == back.attachment
    assert emission.on_sent(15_002_077) == ()
    assert node.next_wake_ns() == 40_001_000
    (emission,) = _emissions(node.wake(41_000_000))
    assert (emission.network, emission.key) == ("east", COMMAND)
    emission.on_sent(41_000_005)
    assert node.next_wake_ns() is None

    records = node.finish(50_000_000)
    assert _batches(records, "/tis/fates") == [
        FateBatch(
            direction="forward",
            key=COMMAND,
            seq=(3,),
            offered_ns=(1_000,),
            outcome=("deliver",),
            delay_ns=(40_000_000,),
            release_ns=(40_001_000,),
            n_bytes=(7,),
            copies=(0,),
            flipped=(0,),
        ),
        FateBatch(
            direction="feedback",
            key=ESTIMATE,
            seq=(9,),
            offered_ns=(2_000,),
            outcome=("deliver",),
            delay_ns=(15_000_000,),
            release_ns=(15_002_000,),
            n_bytes=(8,),
            copies=(0,),
            flipped=(0,),
        ),
    ]
    forward, feedback = _batches(records, "/tis/releases")
    assert forward.released_ns == (41_000_005,)
    assert feedback == ReleaseBatch(
        direction="feedback",
        key=ESTIMATE,
        seq=(9,),
        copy_index=(0,),
        offered_ns=(2_000,),
        release_ns=(15_002_000,),
        released_ns=(15_002_077,),
        departure=("released",),
        queued_ns=(0,),
    )


def test_without_delay_a_packet_leaves_as_it_comes() -> None:
    node = _node()
    (emission,) = node.receive(packet(5_000, seq=0))
    assert isinstance(emission, Emission)
    assert emission.network == "east"
    assert node.next_wake_ns() is None
    assert node.counters()["forward.released"] == 1


def test_what_is_due_already_leaves_before_a_packet_without_delay() -> None:
    node = _node(
        forward={"delay": {"kind": "constant", "delay_ms": 1}},
        rules=[{"key": ESTIMATE, "direction": "forward", "pipeline": {}}],
    )
    node.receive(packet(0, seq=0))
    outputs = node.receive(packet(1 * MS, seq=0, key=ESTIMATE))
    assert [emission.key for emission in _emissions(outputs)] == [COMMAND, ESTIMATE]


def test_a_late_packet_is_recorded_and_not_sent() -> None:
    node = _node(forward={"delay": {"kind": "uniform", "low_ms": 0, "high_ms": 100}, "ordering": "drop_late"})
    for seq in range(100):
        node.receive(packet(seq, seq))
    emissions = _emissions(node.wake(150 * MS))
    for emission in emissions:
        emission.on_sent(150 * MS)
    records = node.finish(151 * MS)
    (fates,) = _batches(records, "/tis/fates")
    (releases,) = _batches(records, "/tis/releases")
    order = sorted(range(100), key=lambda seq: (fates.release_ns[seq], seq))
    sent = [seq for i, seq in enumerate(order) if seq >= max(order[: i + 1])]
    assert len(emissions) == len(sent)
    rows = list(zip(releases.seq, releases.departure, releases.released_ns, strict=True))
    assert [seq for seq, departure, _ in rows if departure == "late"] == [seq for seq in order if seq not in sent]
    assert all(ns == (0 if departure == "late" else 150 * MS) for _, departure, ns in rows)
    counters = node.counters()
    assert counters["forward.dropped.late"] == 100 - counters["forward.released"] > 0


def test_a_copy_and_flipped_bits_leave_as_such() -> None:
    node = _node(forward={"duplicate": {"p_duplicate": 1}, "corrupt": {"p_corrupt": 1, "bits": 2}})
    emissions = _emissions(node.receive(packet(0, seq=0, payload=bytes(16))))
    assert len(emissions) == 2
    flipped = [sum(byte.bit_count() for byte in emission.payload) for emission in emissions]
    assert flipped == [2, 2]
    assert emissions[0].payload == emissions[1].payload
    for emission in emissions:
        emission.on_sent(5)
    records = node.finish(10)
    (releases,) = _batches(records, "/tis/releases")
    (fates,) = _batches(records, "/tis/fates")
    assert releases.copy_index == (0, 1)
    assert (fates.copies, fates.flipped) == ((1,), (2,))
    assert node.counters()["forward.copied"] == 1


def test_foreign_packets_are_refused_or_passed_and_never_raise() -> None:
    strange: list[tuple[str, bytes, bytes]] = [
        ("camera/image", b"\xff\x00", b""),
        ("@ros2_lv/0/x", b"", b"\x00" * 33),
        ("tis/**", b"{}", b"tis\x02"),
        ("a//b", b"", Header(2**32 - 1, -1).pack()),
        ("tis/PSM2/setpoint_cp", b"not json", b"tis\x02" + b"\xff" * 15),
        ("tis/PSM2/setpoint_cp", b"", Header(2**32 - 1, 2**63 - 1).pack()),
    ]
    for unmatched, n_refused in (("refuse", 3), ("pass", 1)):
        node = _node(unmatched=unmatched)
        networks: tuple[Network, ...] = ("west", "east")
        for network in networks:
            for key, payload, attachment in strange:
                outputs = node.receive(Arrival(network, key, payload, attachment, 10))
                for emission in _emissions(outputs):
                    assert emission.payload is payload
                    assert emission.attachment is attachment
                    emission.on_sent(11)
        for direction in ("forward", "feedback"):
            counters = node.counters()
            assert counters[f"{direction}.offered"] == len(strange) - 1  # one could name a key that stays here
            assert counters[f"{direction}.dropped.refused"] == n_refused
            assert counters[f"{direction}.released"] == len(strange) - 1 - n_refused


def test_what_stays_on_its_network_does_not_cross_by_any_name() -> None:
    node = _node(unmatched="pass")
    for network in ("west", "east"):
        for key in ("tis/PSM2/servo_cp", "tis/*/servo_cp", "tis/PSM2/servo$*", "**"):
            assert node.receive(Arrival(network, key, b"{}", b"", 10)) == ()
    assert node.counters()["forward.offered"] == node.counters()["feedback.offered"] == 0


def test_books_are_closed_five_times_a_second() -> None:
    node = _forty_and_fifteen()
    outputs = [output for k in range(100) for output in node.receive(packet(k * 10 * MS, k))]
    batches = _batches(outputs, "/tis/fates")
    assert [len(batch.seq) for batch in batches] == [21, 20, 20, 20]
    assert batches[0].seq == tuple(range(21))  # the packet that comes at 0.2 s closes them


def test_counters_are_written_at_the_end() -> None:
    node = _forty_and_fifteen()
    for seq in range(3):
        node.receive(packet(seq, seq))
    node.wake(40_000_001)
    written = {note.name: note.value for note in _batches(node.finish(50 * MS), "/tis/counters")}
    assert written == node.counters()
    assert (written["forward.offered"], written["forward.released"], written["forward.held_at_end"]) == (
        3,
        2,
        1,
    )
    assert {name for name in written if name.startswith("feedback")} == {
        f"feedback.{name}"
        for name in (
            "offered",
            "copied",
            "released",
            "dropped.loss",
            "dropped.outage",
            "dropped.refused",
            "dropped.overflow",
            "dropped.queue_full",
            "dropped.late",
            "dropped.codel",
            "dropped.evicted",
            "held_at_end",
            "most_held",
            "flipped_bits",
        )
    }


def test_same_scenario_same_fates_to_the_byte() -> None:
    noisy = {
        "loss": {"kind": "bernoulli", "p_loss": 0.1},
        "delay": {"kind": "normal", "mean_ms": 40, "std_ms": 10},
        "jitter": {"kind": "normal", "std_ms": 5},
    }

    def fates(seed: int) -> bytes:
        node = build_netem(scenario(seed=seed, forward=noisy))
        for seq in range(3_000):
            node.receive(packet(seq * MS, seq))
        return b"".join(encode(batch) for batch in _batches(node.finish(4_000 * MS), "/tis/fates"))

    assert fates(1) == fates(1)
    assert fates(1) != fates(2)
