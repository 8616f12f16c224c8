"""Reception at the patient: every message is used, or counted and named."""

from msgspec.structs import asdict

from tests.nodes import Stamp, a_pose, an_arrival
from tis.common.channels import hand_channels
from tis.common.intake import Intake
from tis.common.messages import SampledPose, encode
from tis.common.safety_records import QUARANTINE, QuarantineNote
from tis.common.ticker import SendPlan
from tis.common.units import NS_PER_MS, sample_instant_ns
from tis.patient_side.safety.gate import GateLimits, StreamGate
from tis.patient_side.safety.gated_intake import GatedIntake

COMMAND = "tis/MTML/measured_cp"
DELAY_NS = 40 * NS_PER_MS


def _intake() -> GatedIntake:
    limits = GateLimits(2.0, 5.0, 200.0, 50 * NS_PER_MS)
    gate = StreamGate(SendPlan(30, 1000), (0.0, 0.0, 0.0), limits)
    return GatedIntake(Intake("tis", [hand_channels("left", "PSM2").command]), {COMMAND: gate})


def _take(intake: GatedIntake, k: int, x_m: float, recv_ns: int | None = None, sent_ns: int = 0) -> str:
    """Offer sample ``k``; return used, a quarantine's kind, or ignored."""
    at_ns = sample_instant_ns(k, 30)
    arrival = an_arrival(
        COMMAND, at_ns + DELAY_NS if recv_ns is None else recv_ns, Stamp(k, at_ns, sent_ns), a_pose(x_m)
    )
    accepted, records = intake.take(arrival)
    notes = [record.data for record in records if record.topic == QUARANTINE]
    if accepted is not None:
        assert not notes
        return "used"
    for note in notes:
        assert isinstance(note, QuarantineNote)
        assert (note.key, note.seq, note.recv_ns, note.sample_ns) == (COMMAND, k, arrival.recv_ns, at_ns)
        assert note.x_m == x_m
        assert len(records) == 1
        return note.kind
    return "ignored"


def test_a_second_copy_is_ignored_and_another_content_is_conflicting() -> None:
    intake = _intake()
    assert [_take(intake, 0, 0.0), _take(intake, 0, 0.0), _take(intake, 0, 0.001)] == [
        "used",
        "ignored",
        "conflicting",
    ]
    assert _take(intake, 0, 0.0, sent_ns=1) == "conflicting"
    counters = intake.counters()
    assert (counters["duplicates"], counters["quarantined.conflicting"]) == (1, 2)


def test_numbers_that_are_used_up_early_stay_free_for_the_true_samples() -> None:
    """The next 120 numbers, sent early: their samples lie ahead, and the true ones are used later."""
    intake = _intake()
    assert _take(intake, 0, 0.0) == "used"
    early = [_take(intake, k, 0.0, recv_ns=2 * DELAY_NS) for k in range(1, 121)]
    used = early.count("used")
    assert used <= 4  # those within 50 ms and a period of now
    assert set(early[used:]) == {"ahead", "ignored"}  # more than 1 s ahead they are rejected at once
    found = [_take(intake, k, 0.001) for k in range(1, 121)]
    assert found == ["conflicting"] * used + ["used"] * (120 - used)


def test_a_history_is_used_without_the_samples_that_the_gate_refuses() -> None:
    intake = _intake()
    assert _take(intake, 0, 0.0) == "used"
    earlier = tuple(a_pose(x, sample_ns=sample_instant_ns(k, 30)) for k, x in ((0, 0.5), (1, 0.001), (2, 9.0)))
    at_ns = sample_instant_ns(3, 30)
    message = SampledPose(**asdict(a_pose(0.002, sample_ns=at_ns)), history=earlier)
    arrival = an_arrival(COMMAND, at_ns + DELAY_NS, Stamp(3, at_ns, at_ns), encode(message))
    accepted, records = intake.take(arrival)
    assert accepted is not None
    assert isinstance(accepted.message, SampledPose)
    assert [pose.position_m.x for pose in accepted.message.history] == [0.001]
    assert len(records) == 1
    counters = intake.counters()
    assert (counters["quarantined.conflicting"], counters["quarantined.place"]) == (1, 1)
