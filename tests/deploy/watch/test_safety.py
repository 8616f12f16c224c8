"""Safety states that an observer shows."""

from tis.common.channels import stopped_key
from tis.common.messages import Header, Quaternion, SafetyMode, SetPoint, Vector3, encode
from tis.common.peer_life import Beat
from tis.common.runtime.control import ControlKeys
from tis.common.stop_messages import StopState
from tis.common.units import NS_PER_S
from tis.deploy.watch.book import LiveBook, Sighting
from tis.deploy.watch.safety import SafetyStates, Stretch


def _point(at_s: float, mode: SafetyMode) -> bytes:
    place, level = Vector3(x=0.0, y=0.0, z=0.0), Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    at_ns = round(at_s * NS_PER_S)
    return encode(
        SetPoint(
            sample_ns=at_ns,
            position_m=place,
            orientation=level,
            gripper_rad=0.0,
            hand="left",
            tick=0,
            mode=mode,
            age_ns=0,
        )
    )


def test_the_stretches_of_the_last_seconds_are_those_of_the_set_points() -> None:
    states = SafetyStates()
    for k in range(200):
        states.take("PSM2", _point(k / 10, "hold" if 120 <= k < 150 else "tracking"), 20 * NS_PER_S)
    assert states.stretches(10.0) == {
        "PSM2": [
            Stretch("tracking", 19.9 - 10.0, 12.0),
            Stretch("hold", 12.0, 15.0),
            Stretch("tracking", 15.0, 19.9),
        ]
    }


def test_late_points_and_other_payloads_change_nothing() -> None:
    states = SafetyStates()
    states.take("PSM2", _point(2.0, "tracking"), 20 * NS_PER_S)
    states.take("PSM2", _point(1.0, "safe"), 20 * NS_PER_S)
    states.take("PSM2", b"{}", 20 * NS_PER_S)
    states.take("PSM2", _point(40.0, "safe"), 20 * NS_PER_S)  # far ahead
    assert states.stretches(10.0) == {"PSM2": [Stretch("tracking", 2.0, 2.0)]}


def test_the_book_takes_set_points_of_the_patients_network_only() -> None:
    book = LiveBook("tis")
    for network, arm in (("east", "PSM2"), ("west", "PSM1")):
        book.take(Sighting(network, f"tis/{arm}/servo_cp", 5, Header(0).pack(), _point(1.0, "hold")))  # type: ignore[arg-type]
    assert list(book.safety.stretches(10.0)) == ["PSM2"]


def test_strangers_cannot_fill_the_memory_with_arms() -> None:
    states = SafetyStates()
    for i in range(100):
        states.take(f"ARM{i}", _point(1.0, "hold"), 20 * NS_PER_S)
    assert len(states.stretches(10.0)) == 8


def test_the_book_keeps_what_the_patient_has_evidence_of() -> None:
    book = LiveBook("tis")
    key = ControlKeys("tis").beat("patient")
    alarm = Beat(side="patient", at_ns=5, loop_ns=5, alarms={"conflict": 3 * NS_PER_S})
    for beat in (
        b"{}",
        encode(alarm),
        encode(Beat(side="patient", at_ns=6, loop_ns=6)),
    ):
        book.take(Sighting("east", key, 5, b"", beat))
    assert book.alarms == {"conflict": 3 * NS_PER_S}


def test_the_book_keeps_whether_a_stop_is_in_force() -> None:
    book = LiveBook("tis")
    assert book.is_stopped is None
    for payload in (_told(True), b"{}", encode(Beat(side="patient", at_ns=6, loop_ns=6))):
        book.take(Sighting("east", stopped_key("tis"), 5, b"", payload))
        assert book.is_stopped
    book.take(Sighting("east", stopped_key("tis"), 6, b"", _told(False)))
    assert book.is_stopped is False


def _told(is_stopped: bool) -> bytes:
    numbers = (7,) if is_stopped else ()
    return encode(
        StopState(
            number=7, stop=is_stopped, led_by=7, under=7, in_force=numbers, reasons=("page",) * len(numbers),
            latched=False, release="anyone", refused="",
        )
    )  # fmt: skip
