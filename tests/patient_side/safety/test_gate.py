"""The gate: what a surgeon sends passes in any order of arrival; what nobody can have moved does not."""

from math import cos, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.nodes import a_pose
from tis.common.messages import Pose, Quaternion, Vector3
from tis.common.scenario.safety import Gate
from tis.common.ticker import SendPlan
from tis.common.units import NS_PER_MS, NS_PER_S, sample_instant_ns
from tis.patient_side.safety.gate import GateLimits, Kind, StreamGate, limits_of

RATE_HZ = 30
LIMITS = GateLimits(2.0, 5.0, 200.0, 50 * NS_PER_MS)
DELAY_NS = 40 * NS_PER_MS


def _gate(rate_hz: int = RATE_HZ, copies: int = 1, spacing_ns: int = 0, n_samples: int = 3000) -> StreamGate:
    return StreamGate(SendPlan(rate_hz, n_samples, copies, spacing_ns), (0.0, 0.0, 0.0), LIMITS)


def _where_m(k: int, rate_hz: int = RATE_HZ) -> float:
    return 0.1 * sin(2 * pi * 0.5 * k / rate_hz)


def _send(
    gate: StreamGate, k: int, x_m: float | None = None, seq: int | None = None, late_ns: int = 0
) -> Kind | None:
    at_ns = sample_instant_ns(k, RATE_HZ)
    pose = a_pose(_where_m(k) if x_m is None else x_m, sample_ns=at_ns)
    return gate.refusal(pose, k if seq is None else seq, at_ns + DELAY_NS + late_ns)


@settings(max_examples=60)
@given(
    rate_hz=st.sampled_from([30, 200, 1000]),
    copies=st.integers(1, 4),
    spacing_ns=st.sampled_from([0, 10 * NS_PER_MS, 70 * NS_PER_MS]),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_honest_sample_is_refused_in_any_order(rate_hz: int, copies: int, spacing_ns: int, seed: int) -> None:
    """A hand at up to 2 m/s and 40 m/s^2, with noise of 0.1 mm, on a network that loses, repeats and reorders."""
    rng = np.random.default_rng(seed)
    gate, plan = _gate(rate_hz, copies, spacing_ns, 300), SendPlan(rate_hz, 300, copies, spacing_ns)
    t_s = np.arange(300) / rate_hz
    where_m = 0.1 * np.sin(2 * pi * rng.uniform(0.2, 3.0) * t_s + rng.uniform(0, 6)) + rng.normal(0, 1e-4, 300)
    arrivals = []
    while plan.next_due_ns() is not None:
        packet = plan.pop()
        if rng.random() < 0.7:
            arrivals.append((packet.due_ns + int(rng.uniform(0, 300) * NS_PER_MS), packet.k, packet.seq))
    for recv_ns, k, seq in sorted(arrivals):
        pose = a_pose(float(where_m[k]), sample_ns=sample_instant_ns(k, rate_hz))
        assert gate.refusal(pose, seq, recv_ns) is None


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ({"x_m": 5.0}, "place"),
        ({"x_m": 1e6}, "place"),
        ({"x_m": 1.0}, "speed"),
        ({"seq": 2**32 - 1}, "number"),
        ({"seq": 29}, "number"),
        ({"late_ns": -DELAY_NS - 100 * NS_PER_MS}, "ahead"),
        ({"late_ns": -900 * NS_PER_MS}, "ahead"),
    ],
)
def test_a_forged_sample_is_refused_and_the_true_one_passes(what: dict[str, float], expected: Kind) -> None:
    gate = _gate()
    assert [_send(gate, k) for k in range(30)] == [None] * 30
    assert _send(gate, 30, **what) == expected  # type: ignore[arg-type]
    assert [_send(gate, k) for k in range(30, 60)] == [None] * 30


def test_an_instant_belongs_to_the_sample_that_is_nearest_in_the_plan() -> None:
    gate, half_ns = _gate(), NS_PER_S // RATE_HZ // 2
    for late_ns, of_number in ((half_ns - 1, 3), (1 - half_ns, 5)):
        pose = a_pose(0.0, sample_ns=sample_instant_ns(of_number, RATE_HZ) + late_ns)
        assert gate.refusal(pose, 4, NS_PER_S) == "number"
        assert gate.refusal(pose, of_number, NS_PER_S) is None
    again = a_pose(0.001, sample_ns=sample_instant_ns(3, RATE_HZ))  # another stamp and place for the third sample
    assert gate.refusal(again, 3, NS_PER_S) == "conflicting"
    assert gate.refusal_of_earlier(again) == "conflicting"
    after_the_end = a_pose(0.0, sample_ns=sample_instant_ns(3000, RATE_HZ))
    assert gate.refusal(after_the_end, 3000, 200 * NS_PER_S) == "number"


def test_a_turn_that_no_hand_makes_is_refused() -> None:
    gate = _gate()
    places = [0.0, 0.15, 0.30, 0.15]  # from 4.5 m/s to -4.5 m/s in 33 ms: 270 m/s^2
    assert [_send(gate, k, x) for k, x in enumerate(places)] == [None, None, None, "acceleration"]


@pytest.mark.parametrize("rate_hz", [30, 200, 1000])
def test_a_fast_arm_at_a_high_rate_is_no_change_of_velocity(rate_hz: int) -> None:
    """A drone at 13 m/s in a circle of 7 m has 25 m/s^2, whatever the time between two samples is."""
    limits = LIMITS._replace(reach_m=20.0, speed_m_s=50.0)
    gate = StreamGate(SendPlan(rate_hz, 3000), (0.0, 0.0, 0.0), limits)
    angles = 13.0 / 7.0 * np.arange(2 * rate_hz) / rate_hz
    for k, angle in enumerate(angles):
        at_ns = sample_instant_ns(k, rate_hz)
        where = Vector3(x=7.0 * cos(angle), y=7.0 * sin(angle), z=0.0)
        assert gate.refusal(replace(a_pose(0.0, sample_ns=at_ns), position_m=where), k, at_ns + DELAY_NS) is None
    k, at_ns = len(angles), sample_instant_ns(len(angles), rate_hz)
    back = replace(a_pose(0.0, sample_ns=at_ns), position_m=Vector3(x=7.0 * cos(angles[-1]), y=6.0, z=0.0))
    assert gate.refusal(back, k, at_ns + DELAY_NS) in ("acceleration", "speed")


def _turned(k: int, angle_deg: float, gripper_rad: float = 0.5) -> Pose:
    half = radians(angle_deg) / 2
    turn = Quaternion(x=0.0, y=0.0, z=sin(half), w=cos(half))
    at_ns = sample_instant_ns(k, RATE_HZ)
    return replace(a_pose(_where_m(k), sample_ns=at_ns), orientation=turn, gripper_rad=gripper_rad)


def _whole_gate() -> StreamGate:
    return StreamGate(SendPlan(RATE_HZ, 3000), (0.0, 0.0, 0.0), limits_of(Gate()))


@pytest.mark.parametrize(
    ("angle_deg", "gripper_rad", "expected"),
    [
        (180.0, 0.5, "turn_speed"),
        (-160.0, 0.5, "turn_speed"),
        (100.0, 0.5, None),  # the largest jump between two recorded samples
        (0.0, 1e9, "gripper"),
        (0.0, -3.2, "gripper"),
        (0.0, -3.0, "gripper"),  # within its angles, but 3.5 rad off in 33 ms
        (0.0, -0.3, None),
    ],
)
def test_a_pose_that_turns_or_grips_as_no_arm_does_is_refused(
    angle_deg: float, gripper_rad: float, expected: Kind | None
) -> None:
    gate = _whole_gate()
    for k in range(5):
        assert gate.refusal(_turned(k, 3.0 * k), k, sample_instant_ns(k, RATE_HZ) + DELAY_NS) is None
    at = sample_instant_ns(5, RATE_HZ) + DELAY_NS
    assert gate.refusal(_turned(5, 12.0 + angle_deg, gripper_rad), 5, at) == expected
    if expected is not None:
        assert gate.refusal(_turned(5, 15.0), 5, at) is None


def test_a_turn_to_and_fro_beyond_any_hand_is_refused() -> None:
    """From 4200 to -4200 degrees/s in 33 ms: 252 000 degrees/s^2."""
    gate = _whole_gate()
    angles = [0.0, 140.0, 280.0, 140.0]
    found = [gate.refusal(_turned(k, a), k, sample_instant_ns(k, RATE_HZ) + DELAY_NS) for k, a in enumerate(angles)]
    assert found == [None, None, None, "turn_acceleration"]


def test_a_sample_of_no_orientation_hides_no_turn() -> None:
    gate = _whole_gate()
    assert gate.refusal(_turned(0, 0.0), 0, DELAY_NS) is None
    none = replace(_turned(1, 0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=0.0))
    assert gate.refusal(none, 1, none.sample_ns + DELAY_NS) is None
    turned = _turned(2, 170.0)
    assert gate.refusal(turned, 2, turned.sample_ns + DELAY_NS) == "turn_speed"


def test_a_sample_of_no_orientation_contradicts_no_copy_of_itself() -> None:
    """It came before the sample between it and the one before, whose orientation is another."""
    gate = _whole_gate()
    none = replace(_turned(2, 0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=0.0))
    assert gate.refusal(_turned(0, 0.0), 0, DELAY_NS) is None
    assert gate.refusal(none, 2, none.sample_ns + DELAY_NS) is None
    assert gate.refusal_of_earlier(_turned(1, 20.0)) is None
    assert gate.refusal_of_earlier(none) is None


def test_another_orientation_or_gripper_at_a_known_instant_is_conflicting() -> None:
    gate = _whole_gate()
    assert gate.refusal(_turned(0, 0.0), 0, DELAY_NS) is None
    assert gate.refusal_of_earlier(_turned(0, 1.0)) == "conflicting"
    assert gate.refusal_of_earlier(_turned(0, 0.0, 0.51)) == "conflicting"
    assert gate.refusal_of_earlier(_turned(0, 0.0)) is None


def test_another_content_at_a_known_instant_is_refused() -> None:
    gate = _gate(copies=2)
    pose = a_pose(0.01, sample_ns=0)
    assert gate.refusal(pose, 0, DELAY_NS) is None
    assert gate.refusal(pose, 1, DELAY_NS) is None  # the second copy
    forged = a_pose(0.011, sample_ns=0)
    assert gate.refusal(forged, 1, DELAY_NS) == "conflicting"
    assert gate.refusal_of_earlier(forged) == "conflicting"
    assert gate.refusal_of_earlier(pose) is None


def test_after_a_true_jump_the_movement_is_admitted_when_a_hand_could_be_there() -> None:
    gate = _gate()
    for k in range(30):
        assert _send(gate, k) is None
    found = [_send(gate, k, 1.0 + _where_m(k)) for k in range(30, 60)]
    assert found.index(None) == 5  # 0.2 s after the last sample before the jump
    assert found[5:] == [None] * 25
    assert _send(gate, 60) == "speed"  # now the place before the jump is the one that is far


def test_a_second_movement_is_never_believed_while_the_first_goes_on() -> None:
    gate = _gate()
    for k in range(30):
        assert _send(gate, k) is None
    for k in range(30, 300):
        assert _send(gate, k, 1.0 + _where_m(k), late_ns=-DELAY_NS) == "speed"  # before the true one
        assert _send(gate, k) is None


def test_after_an_outage_the_arm_may_be_anywhere_it_could_have_gone() -> None:
    gate = _gate()
    assert _send(gate, 0, 0.0) is None
    assert _send(gate, 60, 1.5) is None


@pytest.mark.parametrize(
    ("trained", "limits"),
    [
        (None, (2.0, 5.0, 200.0)),
        ((0.2, 1.0, 30.0), (2.0, 5.0, 200.0)),
        ((5.0, 3.0, 30.0), (20.0, 12.0, 200.0)),
        ((29.0, 3.0, 30.0), (50.0, 12.0, 200.0)),  # a rover
        ((200.0, 300.0, 900.0), (2.0, 5.0, 200.0)),  # millimetres
    ],
)
def test_limits_that_are_not_given_follow_from_training_rows(
    trained: tuple[float, float, float] | None, limits: tuple[float, float, float]
) -> None:
    assert limits_of(Gate(), trained=trained)[:3] == limits
    given = Gate.model_validate({"reach_m": 1.0, "speed_m_s": 1.5, "acceleration_m_s2": 7.0})
    assert limits_of(given, trained=trained)[:3] == (1.0, 1.5, 7.0)
