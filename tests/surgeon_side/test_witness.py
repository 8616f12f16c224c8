"""The witness of a foreign surgeon against our own surgeon, whose log it has to write."""

from collections.abc import Iterable

from msgspec.structs import asdict

from tests.nodes import a_pose, a_recording
from tis.common.channels import hand_channels
from tis.common.messages import FeedbackPose, Header, encode
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.records import REJECTED, TICKS, TRUTH
from tis.common.ticker import Ticker
from tis.surgeon_side.motion import RecordedMotion
from tis.surgeon_side.node import Redundancy, SurgeonNode
from tis.surgeon_side.witness import WitnessNode

PERIOD = 33_333_333
RUN = 77


def a_witness(n_ticks: int = 6) -> WitnessNode:
    witness = WitnessNode("tis", [hand_channels("left", "PSM2")], 30, n_ticks)
    witness.join(RUN)
    return witness


def heard(outputs: Iterable[Output], at_ns: int) -> tuple[list[Arrival], list[Record]]:
    """Return what another client of the surgeon's network hears of a surgeon's outputs, and what that one logs."""
    arrivals, records = [], []
    for output in outputs:
        if isinstance(output, Record):
            records.append(output)
            continue
        assert isinstance(output, Emission)
        assert isinstance(output.attachment, Header)
        attachment = output.attachment._replace(sent_ns=at_ns, run_id=RUN).pack()
        arrivals.append(Arrival("west", output.key, output.payload, attachment, at_ns + 90_000))
        records += output.on_sent(at_ns)
    return arrivals, records


def on(topic: str, records: Iterable[Record]) -> list[tuple[int, object]]:
    return [(record.log_ns, record.data) for record in records if record.topic == topic]


def test_its_log_is_that_of_the_surgeon() -> None:
    """Ticks, messages and truth of our surgeon, with a missed tick; the row ahead is all that nobody can hear."""
    surgeon = SurgeonNode("tis", RecordedMotion(a_recording(50)), Ticker(30, 6), Redundancy(2, 9_000_000))
    witness = a_witness()
    own, written = [], []
    for due_ns in (0, 9_000_000, PERIOD, PERIOD + 9_000_000, 4 * PERIOD, 4 * PERIOD + 9_000_000, 5 * PERIOD + 2):
        arrivals, records = heard(surgeon.wake(due_ns + 500), due_ns + 700)
        own += records
        written += [record for arrival in arrivals for record in witness.receive(arrival)]
    for key in ("tis/MTML/measured_cp", "tis/PSM2/setpoint_cp"):
        assert on(key, written) == on(key, own)
        assert [record.seq for record in written if record.topic == key] == [
            record.seq for record in own if record.topic == key
        ]
    ticks = [data for _, data in on(TICKS, own)]
    found = [data for _, data in on(TICKS, written)]
    assert [(t.tick, t.due_ns, t.missed) for t in found] == [(t.tick, t.due_ns, t.missed) for t in ticks]  # type: ignore[attr-defined]
    truth = dict.fromkeys(data.index for _, data in on(TRUTH, written))  # type: ignore[attr-defined]
    assert list(truth) == [0, 1, 4, 5]
    ours = {data.index: data for _, data in on(TRUTH, own)}  # type: ignore[attr-defined]
    assert all(ours[data.index] == data for _, data in on(TRUTH, written))  # type: ignore[attr-defined]
    counters = witness.counters()
    assert all(counters[name] == n for name, n in surgeon.counters().items() if name.startswith("sent"))
    assert counters["ticks_missed"] == surgeon.counters()["ticks_missed"] == 2


def test_ticks_without_a_sample_at_the_end_are_missed() -> None:
    witness = a_witness(n_ticks=4)
    surgeon = SurgeonNode("tis", RecordedMotion(a_recording(50)), Ticker(30, 6))
    for arrival in heard(surgeon.wake(0), 10)[0]:
        witness.receive(arrival)
    last = [data for _, data in on(TICKS, witness.finish(10 * PERIOD))]
    assert [(t.tick, t.missed) for t in last] == [(1, True), (2, True), (3, True)]  # type: ignore[attr-defined]
    assert witness.counters()["ticks_missed"] == 3


def test_it_says_nothing_and_logs_answers() -> None:
    witness = a_witness()
    assert witness.publishes() == ()
    assert witness.next_wake_ns() is None
    payload = encode(FeedbackPose(**asdict(a_pose()), tick=4, command_sample_ns=100))
    (record,) = witness.receive(Arrival("west", "tis/PSM2/estimated_cp", payload, Header(4, 5, RUN).pack(), 9_000))
    assert (record.log_ns, record.publish_ns, record.seq) == (9_000, 5, 4)


def test_what_is_of_another_run_or_no_pose_is_rejected() -> None:
    witness = a_witness()
    good = encode(a_pose())
    for payload, attachment in (
        (good, Header(0, 0, RUN + 1).pack()), (b"junk", Header(0, 0, RUN).pack()), (good, b""),
    ):  # fmt: skip
        records = witness.receive(Arrival("west", "tis/MTML/measured_cp", payload, attachment, 9_000))
        assert [record.topic for record in records] == [REJECTED]
    assert witness.counters()["rejected"] == 3
    assert witness.counters()["sent"] == 0


def test_a_sample_of_the_far_future_makes_no_million_missed_ticks() -> None:
    witness = WitnessNode("tis", [hand_channels("left", "PSM2")], 1000, 4_000_000)
    witness.join(RUN)
    pose = encode(a_pose(sample_ns=3_000 * 10**9))
    arrival = Arrival("west", "tis/MTML/measured_cp", pose, Header(0, 0, RUN).pack(), 3_000 * 10**9)
    assert len(witness.receive(arrival)) == 1
