"""Forces at the surgeon: what is believed, what is shown, and how the hand yields; literal instants."""

import numpy as np
import pytest

from tests.common.coupling.test_stability import HOGAN
from tests.patient_side.arm_models import static_model
from tis.common.channels import hand_channels
from tis.common.device import DevicePose
from tis.common.messages import Header, Pose, ShownForce, Twist, Vector3, Wrench, decode, encode
from tis.common.node import Arrival, Emission
from tis.common.runtime.recordings import load_movement
from tis.common.runtime.signing import SharedSecret
from tis.common.scenario.touch import TouchPart
from tis.common.signing import RunKeys
from tis.common.vector import ZERO, Vector, as_message, of
from tis.deploy.run.resolve import resolve
from tis.patient_side.build import build_patient
from tis.surgeon_side.build import build_surgeon
from tis.surgeon_side.motion import HandPoses, Placed
from tis.surgeon_side.operator import Operator
from tis.surgeon_side.touch import HandTouch, Touch

ROW = hand_channels("left", "PSM2")
MS = 1_000_000


def _hand(**part: object) -> HandTouch:
    touch = TouchPart.model_validate({"fade_after_ms": 100, **part})
    return HandTouch(ROW, touch, MS, Operator(HOGAN, 1e-3), 2.0 * np.eye(3))


def _wrench(tick: int, force: Vector = (0.0, 0.0, 2.0), active: bool = True, **more: object) -> Wrench:
    fields = {"energy_j": None, "wave": None, "command_sample_ns": 0, **more}
    return Wrench(sample_ns=tick * MS, tick=tick, force_n=as_message(force), active=active, **fields)  # type: ignore[arg-type]


def _touch(hand: HandTouch) -> Touch:
    return Touch("tis", [hand], sends_motion=False)


def _arrival(wrench: Wrench, recv_ns: int, seq: int | None = None, run_id: int = 0) -> Arrival:
    header = Header(wrench.tick if seq is None else seq, wrench.sample_ns, run_id)
    return Arrival("west", ROW.force.key("tis"), encode(wrench), header.pack(), recv_ns)


def _tick(hand: HandTouch, k: int) -> ShownForce:
    here = hand.off_m(k)
    return hand.tick(k, k * MS, here, ZERO)[1]


def test_a_force_comes_in_slowly_fades_with_age_and_is_zero_after_the_time() -> None:
    hand = _hand()
    touch = _touch(hand)
    sizes = {}
    for k in range(400):
        if k <= 200:
            touch.take(_arrival(_wrench(k), k * MS))
        sizes[k] = of(_tick(hand, k).force_n)[2]
    assert sizes[0] == pytest.approx(2.0 / 100)
    assert sizes[150] == sizes[250] == 2.0
    assert sizes[275] == pytest.approx(1.0)
    assert set(list(sizes.values())[300:]) == {0.0}


def test_the_force_of_an_arm_that_does_not_follow_fades_too() -> None:
    hand = _hand()
    touch = _touch(hand)
    shown = {}
    for k in range(400):
        touch.take(_arrival(_wrench(k, active=k < 200), k * MS))
        shown[k] = _tick(hand, k)
    assert of(shown[199].force_n)[2] == 2.0
    assert of(shown[250].force_n)[2] == pytest.approx(1.0, abs=0.05)
    assert (of(shown[301].force_n), shown[301].limited) == (ZERO, "inactive")


def test_where_messages_are_signed_no_other_force_or_movement_is_taken() -> None:
    scenario = resolve("touch", ["touch.coupling=wave"], None, 0.01)
    recording, keys = load_movement(scenario), RunKeys(b"a" * 32, (b"b" * 32,))
    surgeon, patient = build_surgeon(scenario, recording), build_patient(scenario, [static_model()], recording)
    twist = encode(Twist(sample_ns=0, velocity_m_s=as_message(ZERO), wave=as_message(ZERO)))
    for node in (surgeon, patient):
        node.believe(keys, SharedSecret(b"c" * 32))
        node.receive(_arrival(_wrench(0, wave=as_message(ZERO)), MS))
        node.receive(Arrival("east", ROW.motion.key("tis"), twist, Header(0, 0, 0).pack(), MS))
    assert (surgeon.counters()["forces_received"], patient.counters()["motions_received"]) == (0, 0)
    assert (surgeon.counters()["forces_rejected"], patient.counters()["motions_rejected"]) == (1, 1)


def test_no_more_than_the_largest_force_is_shown() -> None:
    hand = _hand(force_max_n=1.5)
    touch = _touch(hand)
    for k in range(200):
        touch.take(_arrival(_wrench(k, (0.0, 3.0, 4.0)), k * MS))
        shown = _tick(hand, k)
    assert of(shown.force_n) == pytest.approx((0.0, 0.9, 1.2))
    assert shown.limited == "force"


@pytest.mark.parametrize("coupling", ["position_force", "wave", "tdpa"])
def test_what_cannot_be_true_gives_neither_force_nor_energy(coupling: str) -> None:
    hand = _hand(coupling=coupling, power_max_w=5.0)
    touch = _touch(hand)
    touch.take(_arrival(_wrench(1, energy_j=0.0), 1 * MS, seq=2))
    touch.take(_arrival(_wrench(3), 3 * MS, run_id=9))
    touch.take(_arrival(_wrench(4, (0.0, 0.0, 1e6)), 4 * MS))
    touch.take(_arrival(_wrench(5, wave=as_message((9.0, 0.0, 0.0))), 5 * MS))
    touch.take(_arrival(_wrench(6, energy_j=0.0), 6 * MS))
    before = hand.newest
    touch.take(_arrival(_wrench(7, energy_j=1.0), 7 * MS))
    assert dict(hand.refused) == {"number": 1, "size": 1, "energy": 2}
    assert hand.newest is before
    assert not hand.waves.waves
    counters = touch.counters()
    assert counters["forces_rejected"] == 1
    assert counters["force_refused_energy.left"] == 2


def test_a_simulated_hand_is_pushed_off_where_a_pointer_puts_it() -> None:
    """2 N for long at 568 N/m are 3.5 mm; the pointer moves 10 mm along x, at half scale 5 mm of the arm."""
    settings = ("source.scale=0.5", "touch.operator={damping_ns_m: 60}")
    scenario = resolve("drive_touch", settings, None)
    surgeon = build_surgeon(scenario, load_movement(scenario))
    period_ns, said = 10 * MS, []
    for k in range(300):
        force = encode(_wrench(k, (0.0, 2.0, 0.0)))
        pose = encode(DevicePose(stamp_ns=k, position_m=Vector3(x=0.01 * (k > 0), y=0.0, z=0.0)))
        surgeon.receive(Arrival("west", ROW.force.key("tis"), force, Header(k, k * period_ns).pack(), k * period_ns))
        surgeon.receive(Arrival("west", "device/MTML/measured_cp", pose, b"", k * period_ns))
        said += [one for one in surgeon.wake(k * period_ns) if isinstance(one, Emission)]
    arm, master = (
        [one for one in said if one.key == key] for key in ("tis/PSM2/setpoint_cp", "tis/MTML/measured_cp")
    )
    ends = [[decode(one.payload, Pose).position_m for one in (rows[0], rows[-1])] for rows in (arm, master)]
    moved_mm = [tuple(1e3 * (b - a) for a, b in zip(of(first), of(last), strict=True)) for first, last in ends]
    off_mm = 1e3 * 2.0 / 568.0
    assert moved_mm[0] == pytest.approx((5.0, off_mm, 0.0), abs=0.01)
    assert moved_mm[1] == pytest.approx((10.0, 2.0 * off_mm, 0.0), abs=0.02)
    shown = decode([one for one in said if one.key == "tis/MTML/servo_cf"][-1].payload, ShownForce)
    assert shown.position_m.y - shown.intended_m.y == pytest.approx(off_mm / 1e3, abs=1e-5)


def test_a_duplicate_of_a_wave_is_not_used_again() -> None:
    hand = _hand(coupling="wave")
    touch = _touch(hand)
    for _ in range(3):
        touch.take(_arrival(_wrench(1, wave=as_message((0.1, 0.0, 0.0))), 2 * MS))
    assert len(hand.waves.waves) == 1


def test_master_and_arm_yield_together_and_a_missed_tick_keeps_the_force() -> None:
    hand = _hand()
    touch = _touch(hand)
    for k in range(300):
        touch.take(_arrival(_wrench(k), k * MS))
        if k % 7:
            _tick(hand, k)
    other = Operator(HOGAN, 1e-3)
    assert hand.moved.newest == 300
    for k in range(300):
        other.move((0.0, 0.0, 2.0) if k >= 140 else ZERO)
    placed = Placed((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 0.1)
    found = hand.displaced(HandPoses(placed, placed), 300)
    off = hand.off_m(300)
    assert found.arm.position_m == (1.0 + off[0], 2.0 + off[1], 3.0 + off[2])
    assert found.command.position_m == pytest.approx((1.0 + 2 * off[0], 2.0 + 2 * off[1], 3.0 + 2 * off[2]))
    assert off[2] > 0.0
