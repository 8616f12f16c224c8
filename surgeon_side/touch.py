"""Touch at the surgeon: the forces that come back, as the hands feel them, and what the hands then do.

At a tick the movement since the last one is settled with the force that was held, then the force for the next one is
found from what has arrived. A simulated operator moves under it; a live device gets it on ``servo_cf``.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import HandChannels
from tis.common.coupling.deadband import Deadband
from tis.common.coupling.stability import Limb
from tis.common.coupling.tdpa import PassiveHand, ReceivedEnergy
from tis.common.coupling.wave import WaveHand, WaveQueue, is_too_strong
from tis.common.intake import Accepted, Intake
from tis.common.messages import Header, ShownForce, Twist, Wrench, encode
from tis.common.node import Arrival, Emission, Record
from tis.common.scenario import Scenario
from tis.common.scenario.touch import TouchPart
from tis.common.sources.trajectory import Recording
from tis.common.units import NS_PER_S, ms_to_ns
from tis.common.vector import ZERO, Vector, as_message, limited, minus, of, plus, scaled, size
from tis.surgeon_side.motion import HandPoses, Motion
from tis.surgeon_side.operator import Operator

_FADES_IN_S: Final = 0.1
"""Time in which the force comes and goes with an arm that begins or ceases to follow."""
_TIMES_SHOWN: Final = 10.0
"""So many times the largest force that is shown, a received one counts as damaged."""
_DEVICE_KG: Final = 0.1
"""Mass of a live device, which bounds the damping of passivity controllers."""

Reason = Literal["number", "size", "energy"]
Why = Literal["", "force", "stale", "inactive"]


class _Moved(NamedTuple):
    """The newest two places of a hand off its intention, by the number of the later sample."""

    newest: int = 0
    off_m: Vector = ZERO
    before_m: Vector = ZERO


@dataclass
class HandTouch:
    """One hand: what it feels, and with an operator how it yields; without one a live device moves it."""

    channels: HandChannels
    part: TouchPart
    period_ns: int
    operator: Operator | None
    to_master: NDArray[np.float64]
    newest: Wrench | None = None
    recv_ns: int = 0
    force_n: Vector = ZERO
    share: float = 0.0
    refused: Counter[Reason] = field(default_factory=Counter)
    moved: _Moved = field(default_factory=_Moved)
    _here: Vector | None = None
    _k: int = -1
    # A sample is asked for as truth, as message and for the twist.
    _displaced: tuple[HandPoses, Vector, HandPoses] | tuple[None, None, None] = (None, None, None)

    def __post_init__(self) -> None:
        part, self._period_s = self.part, self.period_ns / NS_PER_S
        mass_kg = _DEVICE_KG if self.operator is None else self.operator.limb.mass_kg
        most_ns_m = mass_kg / self._period_s
        self.waves = WaveQueue()
        self._wave = WaveHand(part.impedance_ns_m, self._period_s, most_ns_m)
        self._passive = PassiveHand(self._period_s, most_ns_m, ReceivedEnergy(part.power_max_w, self._period_s))
        keep_ms = part.deadband.keep_alive_ms
        self.deadband = Deadband(part.deadband.motion, None if keep_ms is None else ms_to_ns(keep_ms))

    def take(self, accepted: Accepted[Wrench], recv_ns: int) -> None:
        """Take a force that came back; one that cannot be true is counted, and gives neither force nor energy."""
        wrench = accepted.message
        reason = self._refusal(wrench, accepted.header.seq)
        if reason is not None:
            self.refused[reason] += 1
            return
        if wrench.wave is not None and self.part.coupling == "wave":
            self.waves.put(of(wrench.wave))
        if self.newest is None or wrench.tick > self.newest.tick:
            self.newest, self.recv_ns = wrench, recv_ns

    def _refusal(self, wrench: Wrench, seq: int) -> Reason | None:
        part = self.part
        if seq != wrench.tick:
            return "number"
        if size(of(wrench.force_n)) > _TIMES_SHOWN * part.force_max_n:
            return "size"
        if wrench.wave is not None and is_too_strong(of(wrench.wave), part.power_max_w):
            return "energy"
        if wrench.energy_j is not None and not self._passive.received.take(wrench.energy_j, wrench.sample_ns):
            return "energy"
        return None

    def tick(self, k: int, t_ns: int, here: Vector, intended: Vector) -> tuple[Twist, ShownForce]:
        """Settle the movement since the last tick, and find the force of the next one; the operator moves on."""
        moved = ZERO if self._here is None else minus(here, self._here)
        velocity = scaled(moved, 1.0 / (self._period_s * max(k - self._k, 1)))
        self._here, self._k = here, k
        pushed, kind = scaled(self.force_n, -1.0), self.part.coupling
        wave = as_message(self._wave.moved(pushed, moved)) if kind == "wave" else None
        energy_j = self._passive.moved(pushed, moved) if kind == "tdpa" else None
        twist = Twist(sample_ns=t_ns, velocity_m_s=as_message(velocity), energy_j=energy_j, wave=wave)
        is_sent = self.deadband.is_sent(velocity, t_ns)
        asked = self._asked(velocity)
        shown, why = self._shown(asked, t_ns)
        self.force_n = shown
        self.yield_until(k + 1)
        newest = self.newest
        note = ShownForce(
            sample_ns=t_ns, hand=self.channels.hand, tick=k, position_m=as_message(here),
            intended_m=as_message(intended), force_n=as_message(shown),
            age_ns=None if newest is None else t_ns - self.recv_ns, limited=why, sent=is_sent,
            command_ns=None if newest is None else newest.command_sample_ns,
        )  # fmt: skip
        return twist, note

    def _asked(self, velocity: Vector) -> Vector:
        """Return the force on the hand that the coupling asks for."""
        if self.newest is None:
            return ZERO
        felt = of(self.newest.force_n)
        if self.part.coupling == "wave":
            return scaled(self._wave.force(velocity, self.waves.take()), -1.0)
        if self.part.coupling == "tdpa":
            return scaled(self._passive.force(scaled(felt, -1.0), velocity), -1.0)
        return felt

    def _shown(self, asked: Vector, t_ns: int) -> tuple[Vector, Why]:
        """Return the force within its limits, and why it is less than what was asked for."""
        if self.newest is None:
            return ZERO, ""
        why: Why = ""
        age = (t_ns - self.recv_ns) / ms_to_ns(self.part.fade_after_ms)
        fresh = min(max(2.0 - 2.0 * age, 0.0), 1.0)
        step = self._period_s / _FADES_IN_S
        self.share = min(self.share + step, 1.0) if self.newest.active else max(self.share - step, 0.0)
        if not self.newest.active:
            why = "inactive"
            self._wave.reset()
            self._passive.reset()
            self.waves.waves.clear()
        if fresh < 1.0:
            why = "stale"
        shown = scaled(asked, fresh * self.share)
        if size(shown) > self.part.force_max_n:
            why, shown = "force", limited(shown, self.part.force_max_n)
        return shown, why

    def yield_until(self, index: int) -> None:
        """Move the operator on to a sample, under the force that is held."""
        if self.operator is None:
            return
        while self.moved.newest < index:
            before = self.operator.off_m
            self.operator.move(self.force_n)
            self.moved = _Moved(self.moved.newest + 1, self.operator.off_m, before)

    def off_m(self, index: int) -> Vector:
        """Return how far the hand is off its intention at a sample: the newest, or the one before it."""
        if index == self.moved.newest:
            return self.moved.off_m
        return self.moved.before_m if index == self.moved.newest - 1 else ZERO

    def displaced(self, poses: HandPoses, index: int) -> HandPoses:
        """Return where the hand is, as master and as commanded arm."""
        off = self.off_m(index)
        if off == ZERO:
            return poses
        intended, by_off, known = self._displaced
        if known is not None and intended is poses and by_off is off:
            return known
        x, y, z = (self.to_master @ np.array(off)).tolist()
        master, arm = poses
        placed = HandPoses(
            master._replace(position_m=plus(master.position_m, (x, y, z))),
            arm._replace(position_m=plus(arm.position_m, off)),
        )
        self._displaced = poses, off, placed
        return placed


class YieldingMotion:
    """A movement as intention: hands that feel forces are off it. Truth is where the hands are."""

    def __init__(self, intention: Motion, hands: Sequence[HandTouch]) -> None:
        self.intention = intention
        self._hands = hands
        self.channels, self.listens = intention.channels, intention.listens
        self.take, self.advance, self.counters = intention.take, intention.advance, intention.counters

    def poses(self, k: int) -> Sequence[HandPoses]:
        """Return where the hands are at sample ``k``."""
        return self._at(self.intention.poses(k), k)

    def truth(self, k: int, is_first: bool) -> Iterator[tuple[int, Sequence[HandPoses]]]:
        """Yield the samples that become known with sample ``k``; at a missed one the hands keep their force."""
        for hand in self._hands:
            hand.yield_until(k + 1)
        for index, poses in self.intention.truth(k, is_first):
            yield index, self._at(poses, index)

    def _at(self, poses: Sequence[HandPoses], index: int) -> Sequence[HandPoses]:
        return [hand.displaced(each, index) for hand, each in zip(self._hands, poses, strict=True)]


@dataclass
class Touch:
    """The touch of all hands of a session."""

    session: str
    hands: Sequence[HandTouch]
    sends_motion: bool
    intake: Intake[Wrench] = field(init=False)

    def __post_init__(self) -> None:
        self.intake = Intake(self.session, [hand.channels.force for hand in self.hands])
        self._by_key = {hand.channels.force.key(self.session): hand for hand in self.hands}
        self.keys = self.intake.wanted()

    @property
    def motion_keys(self) -> list[str]:
        """Keys of the movements that it sends."""
        return [hand.channels.motion.key(self.session) for hand in self.hands] if self.sends_motion else []

    @property
    def shown_keys(self) -> list[str]:
        """Keys of the forces that are shown."""
        return [hand.channels.shown.key(self.session) for hand in self.hands]

    def take(self, arrival: Arrival) -> Sequence[Record]:
        """Take a message on one of its keys; return what to log."""
        accepted, records = self.intake.take(arrival)
        if accepted is not None and not accepted.duplicate:
            self._by_key[arrival.key].take(accepted, arrival.recv_ns)
        return records

    def tick(
        self, k: int, t_ns: int, poses: Sequence[HandPoses], intended: Sequence[HandPoses]
    ) -> tuple[list[tuple[str, Twist]], list[Emission], frozenset[str]]:
        """Return the movements to send at a tick by key, the forces shown, and the keys that are kept back."""
        moves: list[tuple[str, Twist]] = []
        forces: list[Emission] = []
        kept: set[str] = set()
        for hand, at, meant in zip(self.hands, poses, intended, strict=True):
            row = hand.channels
            twist, shown = hand.tick(k, t_ns, at.arm.position_m, meant.arm.position_m)
            if not shown.sent:
                kept |= {row.command.key(self.session), row.arm.key(self.session)}
            elif self.sends_motion:
                moves.append((row.motion.key(self.session), twist))
            forces.append(_emission(row.shown.key(self.session), k, shown))
        return moves, forces, frozenset(kept)

    def counters(self) -> Mapping[str, int]:
        """Return the numbers of forces received, refused by reason, and of movements that were kept back."""
        found: dict[str, int] = {"forces_received": self.intake.n_accepted, "forces_rejected": self.intake.n_rejected}
        for hand in self.hands:
            name = hand.channels.hand
            found |= {f"force_refused_{reason}.{name}": hand.refused[reason] for reason in get_args(Reason)}
            found[f"motion_sent.{name}"] = hand.deadband.n_sent
            found[f"motion_suppressed.{name}"] = hand.deadband.n_suppressed
            found[f"waves_missing.{name}"] = hand.waves.n_missing
        return found


def _emission(key: str, k: int, shown: ShownForce) -> Emission:
    payload = encode(shown)

    def on_sent(sent_ns: int) -> Sequence[Record]:
        return (Record(key, sent_ns, payload, ShownForce, sent_ns, k),)

    return Emission("west", key, payload, Header(k), on_sent)


def build_touch(scenario: Scenario, recording: Recording) -> Touch | None:
    """Return the touch of a scenario; None without."""
    part, source, period_ns = scenario.touch, scenario.source, NS_PER_S // scenario.rate_hz
    if part is None:
        return None
    hands = [
        HandTouch(
            hand.channels,
            part,
            period_ns,
            Operator(Limb(*part.operator.with_device), period_ns / NS_PER_S) if scenario.simulates_hand else None,
            np.eye(3) / source.scale
            if source.kind == "live"
            else _master_by_arm(hand.command.position_m, hand.follower.position_m),
        )
        for hand in recording.hands
    ]
    return Touch(scenario.session, hands, part.coupling != "position_force")


def _master_by_arm(master_m: NDArray[np.float64], arm_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix (3, 3) by which a recording's master moves with its arm, by least squares; 0 at rest."""
    found, *_ = np.linalg.lstsq(arm_m - arm_m.mean(axis=0), master_m - master_m.mean(axis=0), rcond=1e-6)
    return np.asarray(found.T)
