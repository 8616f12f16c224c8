"""An arm of another program: it follows the set points, and its newest pose is the arm's at each tick."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, get_args

import numpy as np

from tis.common.channels import Arm, Hand, arm_key
from tis.common.device import DeviceGate, DeviceSample, Refusal, from_json
from tis.common.device_records import DEVICES, DeviceEvent, DeviceNote
from tis.common.node import Arrival, Record
from tis.common.vector import ZERO
from tis.patient_side.hand import PatientHand
from tis.patient_side.plant.protocol import PlantOutput, Reference

_ARM: Final = "arm"


@dataclass
class ExternalArm:
    """The plant of a hand whose arm is moved elsewhere; what that program sends is checked as a device's poses are.

    It is no simulation: `step` returns the newest pose that arrived at or before the tick, however old, and None
    before the first. Its force is zero while it is silent, or tells none. A silence is logged. Oracle: arrivals with
    literal instants, test_external_arm.
    """

    hand: Hand
    arm: Arm
    silent_ns: int
    newest: DeviceSample | None = None
    n_silences: int = 0
    n_silent_ticks: int = 0
    _gate: DeviceGate = field(init=False, repr=False)
    _notes: list[Record] = field(default_factory=list, repr=False)
    _told: set[Refusal] = field(default_factory=set, repr=False)
    _heard_ns: int = 0
    _is_silent: bool = False

    def __post_init__(self) -> None:
        self._gate = DeviceGate(from_json, self.silent_ns)

    def initial(self) -> None:
        """Return the state: the arm itself holds it."""

    def take(self, arrival: Arrival) -> None:
        """Keep a pose for the next tick."""
        self._gate.take(arrival.recv_ns, arrival.payload)

    def step(
        self,
        state: Any,  # noqa: ARG002  part of the protocol of plants; the arm moves elsewhere
        reference: Reference | None,  # noqa: ARG002
        tick: int,  # noqa: ARG002
        now_ns: int,
    ) -> tuple[None, PlantOutput | None]:
        """Return the newest pose that arrived at or before the tick at ``now_ns``."""
        self._follow(self._gate.drain(), now_ns)
        if self.newest is None:
            return None, None
        position_m = np.array(self.newest.position_m)
        # a pose is right as long as the arm stands; a force that nobody tells any more is none
        force_n = ZERO if self._is_silent else self.newest.force_n or ZERO
        return None, PlantOutput(
            position_m, position_m, np.array(self.newest.orientation), self.newest.gripper_rad, force_n=force_n
        )

    def age_ns(self, now_ns: int) -> int | None:
        """Return the age of the newest pose, counted from its arrival; None before the first."""
        return None if self.newest is None else now_ns - self.newest.recv_ns

    def notes(self) -> Iterator[Record]:
        """Yield the notes since the last call: first pose, silences, returns, and first refusals."""
        yield from self._notes
        self._notes.clear()

    def counters(self) -> dict[str, int]:
        """Return the numbers of used poses, of refused messages by reason, and of silences."""
        refused = {f"{_ARM}_{reason}.{self.hand}": self._gate.refusals[reason] for reason in get_args(Refusal)}
        del refused[f"{_ARM}_jump.{self.hand}"]  # an arm may be anywhere
        return {
            f"{_ARM}_poses.{self.hand}": self._gate.n_poses,
            **refused,
            f"{_ARM}_silences.{self.hand}": self.n_silences,
            f"{_ARM}_silent_ticks.{self.hand}": self.n_silent_ticks,
        }

    def _follow(self, samples: list[DeviceSample], now_ns: int) -> None:
        quiet_ns = now_ns - self._heard_ns
        if samples:
            if self.newest is None:
                self._note(now_ns, "first")
            elif self._is_silent:
                self._note(now_ns, "back", quiet_ns)
            self.newest, self._is_silent = samples[-1], False
            self._heard_ns = self.newest.recv_ns
        elif quiet_ns > self.silent_ns:
            self.n_silent_ticks += 1
            if not self._is_silent:
                self._is_silent = True
                self.n_silences += 1
                self._note(now_ns, "silent", quiet_ns)
        for reason in get_args(Refusal):
            if self._gate.refusals[reason] and reason not in self._told:
                self._told.add(reason)
                self._note(now_ns, "refused", reason=reason)

    def _note(self, now_ns: int, event: DeviceEvent, for_ns: int = 0, reason: str = "") -> None:
        note = DeviceNote(at_ns=now_ns, hand=self.hand, event=event, for_ns=for_ns, reason=reason)
        self._notes.append(Record(DEVICES, now_ns, note))


def external_arms(session: str, hands: Sequence[PatientHand]) -> dict[str, ExternalArm]:
    """Return the arms of other programs by the keys on which they tell where they are."""
    arms = [hand.plant for hand in hands if isinstance(hand.plant, ExternalArm)]
    return {arm_key(session, arm.arm): arm for arm in arms}
