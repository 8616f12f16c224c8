"""Touch at the patient: when the arm is coupled, what is believed of the hand, and the limit of contact."""

import numpy as np
import pytest

from tests.common.coupling.loop import a_servo
from tis.common.channels import hand_channels
from tis.common.messages import Header, Twist, Wrench, decode, encode
from tis.common.node import Arrival
from tis.common.records import ContactNote
from tis.common.scenario.touch import TouchPart
from tis.common.vector import Vector, as_message
from tis.patient_side.hand import vector
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.protocol import PlantOutput
from tis.patient_side.touch import ArmTouch, MotionIntake

ROW = hand_channels("left", "PSM2")
MS = 1_000_000


def _arm(**part: object) -> ArmTouch:
    return ArmTouch(ROW, TouchPart.model_validate(part), 1000, a_servo(400.0))


def _at(z_m: float, force_n: float) -> PlantOutput:
    place: Array = np.array([0.0, 0.0, z_m])
    return PlantOutput(place, place, force_n=(0.0, 0.0, force_n))


def _tick(arm: ArmTouch, k: int, goal: Vector, mode: str = "tracking") -> Wrench | None:
    place = arm.goal(goal, mode)  # type: ignore[arg-type]
    arm.took(place)
    sent = arm.answer("tis", k, k * MS, mode, None)  # type: ignore[arg-type]
    return None if sent is None else decode(sent.payload, Wrench)


def test_by_position_and_force_the_estimate_drives_and_the_force_comes_back() -> None:
    arm = _arm()
    arm.felt(_at(-0.001, 0.4))
    wrench = _tick(arm, 3, (0.0, 0.0, -0.002))
    assert arm.place == (0.0, 0.0, -0.002)
    assert wrench is not None
    assert (wrench.tick, wrench.active, wrench.force_n) == (3, True, as_message((0.0, 0.0, 0.4)))
    assert arm.note is not None
    assert isinstance(arm.note.data, ContactNote)
    assert arm.note.data.force_n == vector(np.array([0.0, 0.0, 0.4]))


@pytest.mark.parametrize("mode", ["hold", "slow_stop", "safe", "resuming"])
def test_an_arm_that_does_not_follow_says_so_and_is_led_by_the_estimate(mode: str) -> None:
    arm = _arm(coupling="wave")
    arm.waves.put((1.0, 0.0, 0.0))
    arm.felt(_at(0.0, 0.0))
    arm.took((0.0, 0.0, 0.0))
    wrench = _tick(arm, 1, (0.0, 0.0, 0.01), mode)
    assert arm.place == (0.0, 0.0, 0.01)
    assert not arm.waves.waves
    assert wrench is not None
    assert not wrench.active


def test_beyond_the_limit_of_contact_only_a_way_back_is_followed() -> None:
    arm = _arm(contact_stop_n=1.0)
    arm.felt(_at(-0.01, 2.0))
    here = (0.0, 0.0, -0.01)
    assert arm.is_pressed((0.0, 0.0, -0.02), here)
    assert arm.is_pressed(None, here)
    assert not arm.is_pressed((0.0, 0.0, -0.005), here)
    arm.felt(_at(-0.01, 0.9))
    assert not arm.is_pressed((0.0, 0.0, -0.02), here)


def _moved(k: int, seq: int | None = None, **more: object) -> Arrival:
    twist = Twist(sample_ns=k * MS, velocity_m_s=as_message((0.0, 0.0, 0.0)), **more)  # type: ignore[arg-type]
    header = Header(k if seq is None else seq, k * MS)
    return Arrival("east", ROW.motion.key("tis"), encode(twist), header.pack(), k * MS + 5)


def test_movements_that_cannot_be_true_are_counted_and_bring_no_energy() -> None:
    arm = _arm(coupling="tdpa", power_max_w=2.0)
    intake = MotionIntake("tis", [arm])
    for message in (
        _moved(0, energy_j=0.0),
        _moved(1, energy_j=0.001),
        _moved(2, 7, energy_j=0.002),
        _moved(3, energy_j=5.0),
    ):
        intake.take(message)
    assert dict(arm.refused) == {"number": 1, "energy": 1}
    assert intake.counters()["motion_refused_energy.left"] == 1


def test_a_change_of_following_is_sent_whatever_the_deadband() -> None:
    arm = _arm(deadband={"force": 1.0, "keep_alive_ms": None})
    arm.felt(_at(0.0, 1.0))
    sent = [
        _tick(arm, k, (0.0, 0.0, 0.0), mode) for k, mode in enumerate(["tracking"] * 3 + ["hold"] * 2 + ["tracking"])
    ]
    assert [one is not None for one in sent] == [True, False, False, True, False, True]
