from collections.abc import Sequence
from typing import Any

from common.channels import Network
from common.header import Header
from common.node import Arrival, Emission, Output, Record
from common.records import FateNote, ReleaseNote
from netem.build import build_netem
from netem.node import NetemNode
from tests.netem.making import KEY, packet, scenario

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


def _fate(outputs: Sequence[Output]) -> FateNote:
    record = outputs[0]
    assert isinstance(record, Record)
    assert isinstance(record.data, FateNote)
    return record.data


def test_wants_every_key_of_both_networks() -> None:
    assert list(_node().listens()) == [("west", "**"), ("east", "**")]
    assert _node().name == "netem"


def test_two_packets_cross_in_opposite_directions() -> None:
    node = _forty_and_fifteen()
    out = packet(1_000, seq=3)
    back = packet(2_000, seq=9, key=ESTIMATE, payload=b"estimate", network="east")
    assert node.receive(out) == [
        Record(
            "/tis/fates",
            1_000,
            FateNote(
                direction="forward",
                key=COMMAND,
                seq=3,
                offered_ns=1_000,
                outcome="deliver",
                delay_ns=40_000_000,
                release_ns=40_001_000,
                n_bytes=7,
            ),
            seq=3,
        )
    ]
    assert node.next_wake_ns() == 40_001_000
    fate = _fate(node.receive(back))
    assert (fate.direction, fate.release_ns, fate.n_bytes) == ("feedback", 15_002_000, 8)
    assert node.next_wake_ns() == 15_002_000

    assert node.wake(15_001_999) == []
    (emission,) = _emissions(node.wake(15_002_000))
    assert (emission.network, emission.key, emission.payload) == ("west", ESTIMATE, b"estimate")
    assert emission.attachment == back.attachment
    assert emission.passport is back.passport
    assert emission.on_sent(15_002_077) == [
        Record(
            "/tis/releases",
            15_002_077,
            ReleaseNote(
                direction="feedback",
                key=ESTIMATE,
                seq=9,
                offered_ns=2_000,
                release_ns=15_002_000,
                released_ns=15_002_077,
            ),
            seq=9,
        )
    ]
    assert node.next_wake_ns() == 40_001_000
    (emission,) = _emissions(node.wake(41_000_000))
    assert (emission.network, emission.key) == ("east", COMMAND)
    assert emission.passport is out.passport
    assert node.next_wake_ns() is None


def test_without_delay_a_packet_leaves_as_it_comes() -> None:
    node = _node()
    record, emission = node.receive(packet(5_000, seq=0))
    assert isinstance(record, Record)
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
    releases = [_fate(node.receive(packet(seq, seq))).release_ns for seq in range(100)]
    outputs = node.wake(200 * MS)
    order = sorted(range(100), key=lambda seq: (releases[seq], seq))
    sent = [seq for i, seq in enumerate(order) if seq >= max(order[: i + 1])]
    notes = [output.data for output in outputs if isinstance(output, Record)]
    assert len(_emissions(outputs)) == len(sent)
    late = [note for note in notes if isinstance(note, ReleaseNote)]
    assert [note.seq for note in late] == [seq for seq in order if seq not in sent]
    assert all(note.late and note.released_ns == 200 * MS for note in late)
    counters = node.counters()
    assert counters["forward.dropped.late"] == len(late) == 100 - counters["forward.released"] > 0


def test_foreign_packets_are_refused_or_passed_and_never_raise() -> None:
    strange: list[tuple[str, bytes, bytes]] = [
        ("camera/image", b"\xff\x00", b""),
        ("@ros2_lv/0/x", b"", b"\x00" * 33),
        ("tis/**", b"{}", b"tis\x01"),
        ("a//b", b"", Header(2**32 - 1, -1).pack()),
        ("tis/PSM2/setpoint_cp", b"not json", b"tis\x01" + b"\xff" * 16),
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
            assert counters[f"{direction}.offered"] == len(strange)
            assert counters[f"{direction}.dropped.refused"] == n_refused
            assert counters[f"{direction}.released"] == len(strange) - n_refused


def test_a_payload_is_only_measured() -> None:
    class Wrapped:
        def __len__(self) -> int:
            return 1234

    wrapped: Any = Wrapped()
    record, emission = _node().receive(Arrival("west", COMMAND, wrapped, b"", 10))
    assert _fate([record]).n_bytes == 1234
    assert isinstance(emission, Emission)
    assert emission.payload is wrapped


def test_counters_are_written_at_the_end() -> None:
    node = _forty_and_fifteen()
    for seq in range(3):
        node.receive(packet(seq, seq))
    node.wake(40_000_001)
    records = node.finish(50 * MS)
    assert all(record.topic == "/tis/counters" and record.log_ns == 50 * MS for record in records)
    written = {record.data.name: record.data.value for record in records}  # type: ignore[union-attr]
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
            "released",
            "dropped.loss",
            "dropped.outage",
            "dropped.refused",
            "dropped.overflow",
            "dropped.late",
            "held_at_end",
        )
    }


def test_same_scenario_same_fates_to_the_byte() -> None:
    noisy = {
        "loss": {"kind": "bernoulli", "p_loss": 0.1},
        "delay": {"kind": "normal", "mean_ms": 40, "std_ms": 10},
        "jitter": {"kind": "normal", "std_ms": 5},
    }

    def fates(seed: int) -> list[str]:
        node = build_netem(scenario(seed=seed, forward=noisy))
        return [_fate(node.receive(packet(seq * MS, seq))).model_dump_json() for seq in range(3_000)]

    assert fates(1) == fates(1)
    assert fates(1) != fates(2)
