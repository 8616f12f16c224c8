"""The channel table: all streams, their publishers, payloads and Zenoh keys.

Names follow CRTK, the convention of dVRK users. Master left (MTML) drives PSM2 and master right (MTMR) drives
PSM1, which is the pairing found in the JIGSAWS recordings.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, Generic, Literal, TypeVar, get_args

from tis.common.messages import (
    FeedbackPose,
    Fragment,
    PredictedPose,
    Sampled,
    SampledPose,
    SetPoint,
    ShownForce,
    Twist,
    Wrench,
)

Hand = Literal["left", "right"]
Arm = Literal["PSM1", "PSM2"]
Direction = Literal["forward", "feedback"]
Network = Literal["west", "east"]
Side = Literal["surgeon", "netem", "patient"]

MASTER: Final[dict[Hand, str]] = {"left": "MTML", "right": "MTMR"}
FOLLOWER: Final[dict[Hand, Arm]] = {"left": "PSM2", "right": "PSM1"}
SAME_NAME: Final[dict[Hand, Arm]] = {"left": "PSM1", "right": "PSM2"}

CONTROL: Final = "@tis"
"""Chunk of the control keys (barrier, clock, end): Zenoh's ``**`` does not match chunks that begin with ``@``."""


SERVO: Final = "servo_cp"
"""Last chunk of the keys of set points."""

EXTERNAL: Final = "arm/measured_cp"
"""Last chunks of the keys on which a program of its own tells where its arm is."""

PREDICTED: Final = "predicted_cp"
"""Last chunk of the keys of predicted poses."""

SHOWN: Final = "servo_cf"
"""Last chunk of the keys of the forces that are shown to hands."""


Payload = TypeVar("Payload", bound=Sampled, covariant=True)


@dataclass(frozen=True)
class Channel(Generic[Payload]):
    """A row of the table: one stream of one device in one direction, or one that ``stays_on`` its network."""

    device: str
    suffix: str
    direction: Direction | None
    payload: type[Payload]
    stays_on: Network | None = None

    def key(self, session: str) -> str:
        """Return the Zenoh key of this channel in ``session``."""
        return f"{session}/{self.device}/{self.suffix}"


@dataclass(frozen=True)
class HandChannels:
    """The channels of one hand: command u and arm y from the surgeon, estimate and measurement back.

    ``driven`` is the set point for the arm's own controller, on the patient's network only; ``predicted`` is the
    surgeon's prediction of the arm, on the surgeon's network only. With touch ``force`` comes back, ``motion`` goes
    forward where the coupling needs it, and ``shown`` is the force for hand or device, on the surgeon's network only.
    """

    hand: Hand
    command: Channel[SampledPose]
    arm: Channel[SampledPose]
    estimated: Channel[FeedbackPose]
    measured: Channel[FeedbackPose]
    driven: Channel[SetPoint]
    predicted: Channel[PredictedPose]
    force: Channel[Wrench]
    motion: Channel[Twist]
    shown: Channel[ShownForce]

    def __iter__(self) -> Iterator[Channel[Any]]:
        """Iterate over the channels, in the order of the table."""
        return (value for value in vars(self).values() if isinstance(value, Channel))


def hand_channels(hand: Hand, arm: Arm) -> HandChannels:
    """Return the channels of ``hand`` when it drives ``arm``."""
    return HandChannels(
        hand=hand,
        command=Channel(MASTER[hand], "measured_cp", "forward", SampledPose),
        arm=Channel(arm, "setpoint_cp", "forward", SampledPose),
        estimated=Channel(arm, "estimated_cp", "feedback", FeedbackPose),
        measured=Channel(arm, "measured_cp", "feedback", FeedbackPose),
        driven=Channel(arm, SERVO, None, SetPoint, stays_on="east"),
        predicted=Channel(arm, PREDICTED, None, PredictedPose, stays_on="west"),
        force=Channel(arm, "measured_cf", "feedback", Wrench),
        motion=Channel(MASTER[hand], "measured_cs", "forward", Twist),
        shown=Channel(MASTER[hand], SHOWN, None, ShownForce, stays_on="west"),
    )


VIDEO: Final = Channel("ECM", "video", "feedback", Fragment)
"""The camera's picture, in fragments; ECM is the endoscopic camera manipulator."""


def camera_key(session: str) -> str:
    """Return the key on which a camera of others tells its frames, each as a JSON object."""
    return f"{session}/{VIDEO.device}/camera"


def direction_of(key: str, session: str) -> Direction | None:
    """Return the direction of the messages on ``key``; None when no channel of the table has this key."""
    return _directions(session).get(key)


def keys_of(direction: Direction, session: str) -> tuple[str, ...]:
    """Return the keys of all channels in ``direction``, for every pairing of hands and arms."""
    return tuple(key for key, way in _directions(session).items() if way == direction)


@cache
def _table(session: str) -> dict[str, Channel[Any]]:
    """Return all channels by key, for every pairing of hands and arms."""
    rows = [hand_channels(hand, arm) for hand in get_args(Hand) for arm in get_args(Arm)]
    return {channel.key(session): channel for channel in (*(one for row in rows for one in row), VIDEO)}


@cache
def _directions(session: str) -> dict[str, Direction]:
    return {key: channel.direction for key, channel in _table(session).items() if channel.direction is not None}


@cache
def measured_keys(session: str) -> tuple[str, ...]:
    """Return the keys of the arms' measured poses, for every pairing of hands and arms."""
    arms = (hand_channels(hand, arm).measured for hand in get_args(Hand) for arm in get_args(Arm))
    return tuple(dict.fromkeys(channel.key(session) for channel in arms))


@cache
def local_keys(session: str, network: Network) -> frozenset[str]:
    """Return the keys of all channels that stay on ``network``; in the east those of others' arms and camera, too."""
    own = [key for key, channel in _table(session).items() if channel.stays_on == network]
    foreign = (*(arm_key(session, arm) for arm in get_args(Arm)), camera_key(session)) if network == "east" else ()
    return frozenset((*own, *foreign))


def arm_key(session: str, arm: Arm) -> str:
    """Return the key on which a program that moves an arm tells where it is: `tis.common.device.DevicePose`."""
    return f"{session}/{arm}/{EXTERNAL}"


def is_set_point(key: str) -> bool:
    """Tell whether a key is that of an arm's set points, in any session."""
    return key.endswith(f"/{SERVO}")


def is_predicted(key: str) -> bool:
    """Tell whether a key is that of an arm's predicted poses, in any session."""
    return key.endswith(f"/{PREDICTED}")


def is_shown_force(key: str) -> bool:
    """Tell whether a key is that of the forces shown to a hand, in any session."""
    return key.endswith(f"/{SHOWN}")


def stop_key(session: str) -> str:
    """Return the key of emergency stops; netem passes them on at once, outside the emulated network."""
    return f"{session}/{CONTROL}/stop"


def release_key(session: str) -> str:
    """Return the key of releases, which not everybody may end a stop with; netem passes them on as it does stops."""
    return f"{session}/{CONTROL}/release"


def stopped_key(session: str) -> str:
    """Return the key on which the patient answers requests to stop or to release with the arms' state."""
    return f"{session}/{CONTROL}/stopped"


DESTINATION: Final[dict[Direction, Network]] = {"forward": "east", "feedback": "west"}
SIDE_ON: Final[dict[Network, Side]] = {"west": "surgeon", "east": "patient"}
ORIGIN: Final[dict[Direction, Network]] = {"forward": "west", "feedback": "east"}
OPPOSITE: Final[dict[Direction, Direction]] = {"forward": "feedback", "feedback": "forward"}
