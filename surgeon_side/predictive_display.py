"""Predictive display: the arm as the feedback shows it, and where it will be when the newest command takes effect.

A Smith predictor. The feedback shows the arm as it was; the forward model (`CommandedArm`) adds the motion that was
commanded since and is not in the feedback yet: ``predicted = shown + model(newest command) - model(instant shown)``.
The shown position corrects the model, so a constant offset of the arm does not matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp, inf
from typing import Final, NamedTuple

from tis.common.channels import Channel, Hand, HandChannels
from tis.common.messages import MAX_SIZE, FeedbackPose, Header, Pose, PredictedPose, Vector3, encode, position_m
from tis.common.node import Emission, Record
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.surgeon_side.commanded_arm import CommandedArm, Place, Servo
from tis.surgeon_side.motion import SampleMessage

_SHARES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""An estimator at the patient makes up for a part of the delay: shares of a sample's age at the tick."""

_LAGS_MS: Final = (25, 50, 100, 200)
"""An arm of unknown dynamics lags behind its command."""

_FORGET_S: Final = 3.0
"""Time constant with which the fit of each timing forgets."""

_MAX_ERROR_M: Final = 1.0  # of a damaged position, which would hide all others for long


class _Fit(NamedTuple):
    """Weight of the feedback noted, mean (3,) in m of its distance from the model, and variance about that in m2."""

    weight: float = 0.0
    mean_m: Place = (0.0, 0.0, 0.0)
    variance_m2: float = 0.0

    def after(self, shown_m: Place, modelled_m: Place, kept: float) -> "_Fit":
        """Return the fit after another feedback; what came before counts ``kept`` times (West 1979)."""
        weight = kept * self.weight + 1.0 - kept
        gain = (1.0 - kept) / weight
        far_m = [min(max(a - b, -_MAX_ERROR_M), _MAX_ERROR_M) for a, b in zip(shown_m, modelled_m, strict=True)]
        dx, dy, dz = (far - mean for far, mean in zip(far_m, self.mean_m, strict=True))
        x, y, z = self.mean_m
        variance_m2 = (1.0 - gain) * (self.variance_m2 + gain * (dx * dx + dy * dy + dz * dz))
        return _Fit(weight, (x + gain * dx, y + gain * dy, z + gain * dz), variance_m2)


@dataclass
class ArmTiming:
    """Instant of the commands whose effect a feedback shows, found by the fit of each possible timing.

    The instant is that of the newest command at the patient's tick (timing 0, taken at first), later by a share of
    that command's age where an estimator makes up for delay, or earlier by the arm's own lag. The timing is chosen
    for which ``shown - model(instant)`` varies least over the last seconds. Oracle: arms of known timing
    (tests/surgeon_side/test_predictive_display).
    """

    fits: list[_Fit] = field(default_factory=lambda: [_Fit()] * (len(_SHARES) + len(_LAGS_MS)))
    last_ns: int | None = None

    def instants_ns(self, feedback: FeedbackPose, command_ns: int) -> list[int]:
        """Return the instant for each timing, in ns."""
        age_ns = max(feedback.sample_ns - command_ns, 0)
        later = [command_ns + round(share * age_ns) for share in _SHARES]
        return later + [command_ns - lag_ms * NS_PER_MS for lag_ms in _LAGS_MS]

    def note(self, at_ns: int, shown_m: Place, modelled: Sequence[Place | None]) -> None:
        """Note how well each timing explains a feedback; a timing without a modelled place is left as it is."""
        kept = 0.0 if self.last_ns is None else exp(-max(at_ns - self.last_ns, 0) / NS_PER_S / _FORGET_S)
        self.last_ns = at_ns
        if kept < 1.0:
            self.fits = [
                fit if place is None else fit.after(shown_m, place, kept)
                for fit, place in zip(self.fits, modelled, strict=True)
            ]

    def best(self, modelled: Sequence[Place | None]) -> Place | None:
        """Return the place at the timing that fits best, the first of equals, of those noted long enough."""
        enough = self.fits[0].weight / 2.0
        costs_m2 = [
            inf if place is None or fit.weight < enough else fit.variance_m2
            for fit, place in zip(self.fits, modelled, strict=True)
        ]
        return modelled[min(range(len(costs_m2)), key=costs_m2.__getitem__)]


@dataclass
class Shown:
    """The newest feedback, the command that it answers, its arrival, and the model's place then."""

    feedback: FeedbackPose
    command_ns: int
    recv_ns: int
    modelled_m: Place


@dataclass
class PredictiveDisplay:
    """What the surgeon sees of one arm: `command` and `feedback` feed it, `show` draws it.

    Of the feedback between two pictures the newest is used.
    """

    hand: Hand
    arm: CommandedArm
    timing: ArmTiming = field(default_factory=ArmTiming)
    shown: Shown | None = None
    waiting: tuple[FeedbackPose, int] | None = None

    def command(self, tick: int, pose: Pose) -> None:
        """Take the pose that is commanded to the arm at ``tick``, as it is sent."""
        self.arm.command(tick, position_m(pose))

    def feedback(self, pose: FeedbackPose, recv_ns: int) -> None:
        """Take the arm's pose as it arrives, to be shown next, unless it answers no command or an older one."""
        newest = self.waiting[0] if self.waiting else self.shown.feedback if self.shown else None
        is_newer = newest is None or pose.sample_ns > newest.sample_ns
        if is_newer and pose.command_sample_ns is not None and self.arm.at(pose.command_sample_ns) is not None:
            self.waiting = pose, recv_ns

    def _take_waiting(self) -> None:
        """Show the newest feedback; model the instant that it shows."""
        if self.waiting is None or (command_ns := self.waiting[0].command_sample_ns) is None:
            return
        (pose, recv_ns), self.waiting = self.waiting, None
        shown_m = position_m(pose)
        modelled = [self.arm.at(instant_ns) for instant_ns in self.timing.instants_ns(pose, command_ns)]
        self.timing.note(pose.sample_ns, shown_m, modelled)
        place = self.timing.best(modelled)
        if place is not None:
            self.shown = Shown(pose, command_ns, recv_ns, place)

    def show(self, tick: int, commanded: Pose) -> PredictedPose | None:
        """Return the display at ``tick``, with the command sent then; None before the first feedback."""
        self._take_waiting()
        newest_m = self.arm.at(commanded.sample_ns)
        if self.shown is None or newest_m is None:
            return None
        feedback = self.shown.feedback
        x, y, z = (
            at + to - since
            for at, to, since in zip(position_m(feedback), newest_m, self.shown.modelled_m, strict=True)
        )
        # a damaged feedback, at the end of what a pose can be
        if not all(abs(part) <= MAX_SIZE for part in (x, y, z)):
            return None
        return PredictedPose(
            sample_ns=commanded.sample_ns,
            position_m=Vector3(x=x, y=y, z=z),
            orientation=commanded.orientation,
            gripper_rad=commanded.gripper_rad,
            hand=self.hand,
            tick=tick,
            shown_tick=feedback.tick,
            shown_m=feedback.position_m,
            command_ns=self.shown.command_ns,
            round_trip_ns=self.shown.recv_ns - self.shown.command_ns,
        )


MAX_RATE_HZ: Final = 120
"""Pictures a second of a display: no screen shows more, and each costs a tick of 1 kHz a part of its time."""


class Displays:
    """Displays of all arms of a session. What they show is published on the surgeon's network only, and logged.

    They show every tick, or at fast rates every n-th, at most `MAX_RATE_HZ` a second.
    """

    def __init__(self, session: str, hands: Sequence[HandChannels], rate_hz: int, servo: Servo | None) -> None:
        self._by_command: dict[str, tuple[PredictiveDisplay, Channel[PredictedPose], str]] = {}
        self._by_feedback: dict[str, PredictiveDisplay] = {}
        self._every = -(-rate_hz // MAX_RATE_HZ)
        for channels in hands:
            display = PredictiveDisplay(channels.hand, CommandedArm(rate_hz, servo))
            predicted = channels.predicted
            self._by_command[channels.arm.key(session)] = (display, predicted, predicted.key(session))
            self._by_feedback[channels.measured.key(session)] = display

    @property
    def keys(self) -> Sequence[str]:
        """Keys of the predicted poses."""
        return [key for _, _, key in self._by_command.values()]

    def feedback(self, key: str, pose: Pose, recv_ns: int) -> None:
        """Take an answer of the patient; only the arm's measured pose is displayed."""
        display = self._by_feedback.get(key)
        if display is not None and isinstance(pose, FeedbackPose):
            display.feedback(pose, recv_ns)

    def sampled(self, tick: int, messages: Sequence[SampleMessage]) -> Sequence[Emission]:
        """Take the commands of a tick; return the displays at that instant."""
        shown = []
        for message in messages:
            if message.key in self._by_command:
                display, channel, key = self._by_command[message.key]
                display.command(tick, message.message)
                predicted = display.show(tick, message.message) if tick % self._every == 0 else None
                if predicted is not None:
                    shown.append(_emission(channel, key, tick, encode(predicted)))
        return shown


def _emission(channel: Channel[PredictedPose], key: str, tick: int, payload: bytes) -> Emission:
    def on_sent(sent_ns: int) -> Sequence[Record]:
        return (Record(key, sent_ns, payload, channel.payload, sent_ns, tick),)

    return Emission("west", key, payload, Header(tick), on_sent)
