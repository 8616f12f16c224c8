"""The source of a live operator: poses of a device, from Zenoh keys of the surgeon's network, and their mapping."""

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from tis.common.channels import CONTROL, Hand
from tis.common.scenario.base import AnySource, Milliseconds, Part, Positive, obeys
from tis.common.scenario.identification import is_model_file
from tis.common.units import MM_PER_M
from tis.common.zenoh_syntax import key_expression_fault

Millimetres = Annotated[float, Field(ge=-100_000, le=100_000)]
PlaceMm = tuple[Millimetres, Millimetres, Millimetres]
"""A place (x, y, z), in mm."""

Degrees = Annotated[float, Field(ge=-360, le=360)]
_MAX_KEY_CHARS: Final = 200


def _ros2_key_fault(key: str) -> str | None:
    """Check a topic's key expression in rmw_zenoh, whose last chunks (type name and hash) may be wildcards."""
    if len(key) > _MAX_KEY_CHARS or CONTROL in key.split("/"):
        return f"must have at most {_MAX_KEY_CHARS} characters and no chunk {CONTROL}"
    return None


DeviceKey = Annotated[str, obeys(key_expression_fault), obeys(_ros2_key_fault)]


class DeviceKeys(Part):
    """Keys on which the devices of the two hands publish, on the surgeon's network."""

    left: DeviceKey = Field("device/MTML/measured_cp", description="Key of the left hand's device.")
    right: DeviceKey = Field("device/MTMR/measured_cp", description="Key of the right hand's device.")

    def of(self, hand: Hand) -> str:
        """Return the key of a hand's device."""
        return self.left if hand == "left" else self.right


class LivePlaces(Part):
    """A place for each hand, in mm."""

    left: PlaceMm = Field(description="Place of the left hand, x y z in mm.")
    right: PlaceMm = Field(description="Place of the right hand, x y z in mm.")

    def of_m(self, hand: Hand) -> tuple[float, float, float]:
        """Return the place of a hand, in m."""
        x, y, z = self.left if hand == "left" else self.right
        return x / MM_PER_M, y / MM_PER_M, z / MM_PER_M


class LiveSource(AnySource):
    """Poses of an operator's device that arrive while the run goes on.

    With the device's position d, its position d0 at the beginning (``origin: first``) or 0 (``origin: zero``) and the
    rotation R, the master is at ``master_at_mm + R (d - d0)`` and the arm is commanded to ``arm_at_mm + scale R (d -
    d0)``, less what the device moved while the clutch was pressed. The commanded arm is the truth of the scores.
    """

    kind: Literal["live"] = Field(description="live: a device, on Zenoh keys of the surgeon's network.")
    hands: Annotated[tuple[Hand, ...], Field(min_length=1, max_length=2)] = Field(
        ("left",), description="Masters that move: left, right or both."
    )
    encoding: Literal["json", "ros2"] = Field(
        "json",
        description="Encoding of the device's messages. json: a DevicePose; ros2: a geometry_msgs/PoseStamped as "
        "CDR, on a key of rmw_zenoh.",
    )
    keys: DeviceKeys = Field(DeviceKeys(), description="Keys of the devices.")
    origin: Literal["first", "zero"] = Field(
        "first",
        description="Origin of the device's movement. first: where its first pose is; zero: the origin of its frame.",
    )
    rotation_deg: tuple[Degrees, Degrees, Degrees] = Field(
        (0.0, 0.0, 0.0),
        description="Rotation from the device's axes to those of master and arm, as axis times angle, in degrees.",
    )
    scale: float = Field(
        0.5, ge=0.01, le=10, description="Movement of the arm for a movement of the master; 0.5 as in the recordings."
    )
    master_at_mm: LivePlaces = Field(
        LivePlaces(left=(100.0, -50.0, 350.0), right=(200.0, 50.0, 350.0)),
        description="Place of the master while the device is at its origin, by hand, in mm.",
    )
    arm_at_mm: LivePlaces = Field(
        LivePlaces(left=(50.0, 25.0, 25.0), right=(0.0, 25.0, -25.0)),
        description="Place of the commanded arm while the device is at its origin, by hand, in mm.",
    )
    max_speed_mm_s: Positive = Field(
        2000.0,
        le=100_000,
        description="Largest speed of the device between two ticks, in mm/s. A faster movement is a jump: it is not "
        "followed, and the movement goes on from the device's new place.",
    )
    silent_after_ms: Annotated[Milliseconds, Field(gt=0)] = Field(
        500.0,
        description="Time without a pose after which the device counts as silent, in ms. Its last pose holds, and "
        "the run's report says so.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> "LiveSource":
        if len(set(self.hands)) != len(self.hands):
            raise ValueError("hands must name each hand at most once")
        if self.keys.left == self.keys.right:
            raise ValueError("keys must differ: each hand has a device of its own")
        if self.encoding == "json" and any("*" in key for key in (self.keys.left, self.keys.right)):
            raise ValueError(f"must be one Zenoh key, without *, of at most {_MAX_KEY_CHARS} characters")
        return self

    @property
    def label(self) -> str:
        """Return what moves."""
        return "live device"

    @property
    def device_keys(self) -> tuple[str, ...]:
        """Return the key expressions of the devices of all hands."""
        return tuple(self.keys.of(hand) for hand in self.hands)

    @property
    def start(self) -> int:
        """Return 0: the movement begins with the run, there are no rows before it."""
        return 0

    def rules(self, session: str, rate_hz: int, train: str, plant: str) -> dict[str, bool]:  # noqa: ARG002
        """Return the rules of a movement that nobody has recorded: of the arm, the training and the keys."""
        first = {key.split("/")[0] for key in self.device_keys}
        return {
            "patient.plant.kind must not be replay with a live source: there is no recorded arm to replay": (
                plant != "replay"
            ),
            "identification.train must be synthetic or a model file with a live source, which has no training rows": (
                train == "synthetic" or is_model_file(train)
            ),
            f"source.keys must not begin with {session}/, the run's own keys, which cross the network": (
                not first & {session, "*", "**"}
            ),
        }
