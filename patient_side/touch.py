"""Touch at the patient: what drives an arm that touches, and the force that goes back to the hand."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from tis.common.channels import HandChannels
from tis.common.coupling.deadband import Deadband
from tis.common.coupling.tdpa import PassiveArm, ReceivedEnergy
from tis.common.coupling.wave import WaveArm, WaveQueue, is_too_strong
from tis.common.intake import Accepted, Intake
from tis.common.messages import Header, SafetyMode, Twist, Wrench, encode
from tis.common.node import Arrival, Emission, Record
from tis.common.records import CONTACTS, ContactNote
from tis.common.scenario.touch import TouchPart
from tis.common.units import ms_to_ns, sample_instant_ns
from tis.common.vector import ZERO, Vector, as_message, dot, minus, of, plus, scaled, size
from tis.patient_side.plant.protocol import PlantOutput
from tis.patient_side.plant.touching_servo import TouchingServo

_CATCHES_UP_PER_S = 5.0
"""Rate at which a set point that yielded comes back to the estimate, as far as the energy allows."""

Reason = Literal["number", "energy"]


@dataclass
class ArmTouch:
    """One arm: its coupling to the hand, and what it feels at a tick.

    A tick calls `felt`, `goal`, `took` and `answer` in this order. ``servo`` is None where the coupling does not need
    the arm's spring.
    """

    channels: HandChannels
    part: TouchPart
    rate_hz: int
    servo: TouchingServo | None
    place: Vector | None = None
    """The set point in force."""
    refused: Counter[Reason] = field(default_factory=Counter)
    n_wrenches: int = 0
    _arm: Vector | None = None
    _force: Vector = ZERO
    _was_active: bool = False
    _estimate: Vector | None = None
    _step: Vector = ZERO
    _before: Vector | None = None
    note: Record | None = None
    """The record of the newest tick."""

    def __post_init__(self) -> None:
        part, self._period_s = self.part, 1.0 / self.rate_hz
        stiffness = 1.0 if self.servo is None else self.servo.stiffness_n_m
        self.waves = WaveQueue()
        self._wave = WaveArm(part.impedance_ns_m, self._period_s, stiffness)
        self._passive = PassiveArm(stiffness, ReceivedEnergy(part.power_max_w, self._period_s))
        keep_ms = part.deadband.keep_alive_ms
        self.deadband = Deadband(part.deadband.force, None if keep_ms is None else ms_to_ns(keep_ms))

    def take(self, accepted: Accepted[Twist]) -> None:
        """Take the hand's movement; one that cannot be true is counted, and gives no energy."""
        twist = accepted.message
        if twist.sample_ns != sample_instant_ns(accepted.header.seq, self.rate_hz):
            self.refused["number"] += 1
        elif (twist.wave is not None and is_too_strong(of(twist.wave), self.part.power_max_w)) or (
            twist.energy_j is not None and not self._passive.received.take(twist.energy_j, twist.sample_ns)
        ):
            self.refused["energy"] += 1
        elif twist.wave is not None and self.part.coupling == "wave":
            self.waves.put(of(twist.wave))

    def felt(self, moved: PlantOutput | None) -> None:
        """Take where the arm is at the tick, and the force on it."""
        if moved is not None and moved.force_n is not None:
            x, y, z = moved.position_m.tolist()
            self._arm, self._force = (x, y, z), moved.force_n

    def goal(self, estimate: Vector | None, mode: SafetyMode | None) -> Vector | None:
        """Return where the coupling leads the set point; the estimate, unless waves or energies decide.

        ``mode`` is the safety state so far, None without one: only an arm that follows is coupled.
        """
        kind, before, self._estimate = self.part.coupling, self._estimate, estimate
        is_active = mode in ("tracking", None) and self._arm is not None and self.place is not None
        if estimate is None or kind == "position_force" or not is_active:
            self._wave.reset()
            self.waves.waves.clear()
            return estimate
        assert self.place is not None
        stretch = self._stretch()
        if kind == "wave":
            return plus(self.place, self._wave.step(self.waves.take(), stretch))
        ahead = minus(before or estimate, self.place)
        wanted = plus(minus(estimate, before or estimate), scaled(ahead, _CATCHES_UP_PER_S * self._period_s))
        return plus(self.place, self._passive.step(wanted, stretch))

    def is_pressed(self, goal: Vector | None, place: Vector | None) -> bool:
        """Tell whether the force exceeds the limit, and the goal does not lead back out of it."""
        most = self.part.contact_stop_n
        if most is None or size(self._force) <= most:
            return False
        return goal is None or place is None or dot(minus(goal, place), self._force) <= 0.0

    def took(self, place: Vector | None) -> None:
        """Take the set point that drives the arm from now on."""
        self._step = ZERO if place is None or self.place is None else minus(place, self.place)
        self._before, self.place = self.place, place

    def _stretch(self) -> Vector:
        """Return how far the arm is behind the set point."""
        assert self.place is not None
        return ZERO if self._arm is None else minus(self.place, self._arm)

    def answer(
        self, session: str, tick: int, t_ns: int, mode: SafetyMode | None, command_ns: int | None
    ) -> Emission | None:
        """Return the force of the tick to send, None where the deadband keeps it back; its record is in ``note``."""
        is_active = mode in ("tracking", None) and self.place is not None
        felt, energy_j, wave = self._force, None, None
        if self.part.coupling != "position_force" and self._before is not None and self._arm is not None:
            stretch = minus(self._before, self._arm)
            if self.part.coupling == "wave":
                outgoing, force = self._wave.moved(stretch, self._step)
                wave = as_message(outgoing)
            else:
                energy_j, force = self._passive.moved(stretch, self._step)
            felt = scaled(force, -1.0)
            if not is_active:
                self._wave.reset()
                self._passive.reset()
        if is_active != self._was_active:
            self.deadband.last = None
        self._was_active = is_active
        is_sent = self.deadband.is_sent(felt, t_ns)
        hand = self.channels.hand
        note = ContactNote(
            tick=tick, t_ns=t_ns, hand=hand, force_n=as_message(self._force), sent=is_sent, active=is_active
        )
        self.note = Record(CONTACTS, t_ns, note)
        if not is_sent:
            return None
        wrench = Wrench(
            sample_ns=t_ns, tick=tick, force_n=as_message(felt), energy_j=energy_j, wave=wave, active=is_active,
            command_sample_ns=command_ns,
        )  # fmt: skip
        return self._emission(session, tick, wrench)

    def _emission(self, session: str, tick: int, wrench: Wrench) -> Emission:
        key, payload = self.channels.force.key(session), encode(wrench)

        def on_sent(sent_ns: int) -> Sequence[Record]:
            self.n_wrenches += 1
            return (Record(key, sent_ns, payload, Wrench, sent_ns, tick),)

        return Emission("east", key, payload, Header(tick), on_sent)

    def counters(self) -> dict[str, int]:
        """Return the numbers of forces sent and kept back, and of movements refused by reason."""
        hand = self.channels.hand
        return {
            f"force_sent.{hand}": self.deadband.n_sent,
            f"force_suppressed.{hand}": self.deadband.n_suppressed,
            f"waves_missing.{hand}": self.waves.n_missing,
            **{f"motion_refused_{reason}.{hand}": self.refused[reason] for reason in get_args(Reason)},
        }


@dataclass
class MotionIntake:
    """The hands' movements as they arrive, where a coupling needs them."""

    session: str
    arms: Sequence[ArmTouch]
    intake: Intake[Twist] = field(init=False)

    def __post_init__(self) -> None:
        arms = [arm for arm in self.arms if arm.part.coupling != "position_force"]
        self.intake = Intake(self.session, [arm.channels.motion for arm in arms])
        self._by_key = {arm.channels.motion.key(self.session): arm for arm in arms}
        self.keys = frozenset(self._by_key)

    def take(self, arrival: Arrival) -> Sequence[Record]:
        """Take a message on one of the keys; return what to log."""
        accepted, records = self.intake.take(arrival)
        if accepted is not None and not accepted.duplicate:
            self._by_key[arrival.key].take(accepted)
        return records

    def counters(self) -> dict[str, int]:
        """Return the counters of all arms; none without touch."""
        if not self.arms:
            return {}
        found = {"motions_received": self.intake.n_accepted, "motions_rejected": self.intake.n_rejected}
        return found | {name: n for arm in self.arms for name, n in arm.counters().items()}
