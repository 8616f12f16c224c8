"""The device behind the page: poses of the driven hand, published on the surgeon's network like any device's."""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Final

import zenoh

from tis.common.channels import FOLLOWER, Hand
from tis.common.device import DevicePose
from tis.common.errors import TisError
from tis.common.messages import Vector3, encode
from tis.common.runtime.connections import closing
from tis.common.runtime.tls_links import of_netem_only
from tis.common.runtime.zenoh_session import ZenohOptions, open_client, publisher_of, visitor
from tis.common.scenario import Scenario
from tis.common.units import MM_PER_M

_MAX_M: Final = 100.0  # of a hand that many pages have moved on; no arm is that large


@dataclass(frozen=True)
class Device:
    """The hand that the page moves, the key of its poses, and the mapping from its movement to the arm's."""

    hand: Hand
    key: str
    scale: float
    rotation_deg: Sequence[float]

    @property
    def arm(self) -> str:
        """Return the arm that the hand drives."""
        return FOLLOWER[self.hand]


def device_of(scenario: Scenario) -> Device | None:
    """Return the device that a page of this run can be: the first hand's of a live source in JSON, else None."""
    source = scenario.source
    if source.kind != "live" or source.encoding != "json":
        return None
    hand = source.hands[0]
    return Device(hand, source.keys.of(hand), source.scale, source.rotation_deg)


def device_pose(
    device: Device, moved_mm: Sequence[float], gripper_rad: float, clutch: bool, stamp_ns: int
) -> DevicePose:
    """Return the pose at which the source commands the arm ``moved_mm`` from its origin, along the arm's axes.

    The source rotates a device's movement and scales it, so this divides by its scale and rotates back. Oracle: the
    source's own mapping, tests/deploy/view/test_device.
    """
    from scipy.spatial.transform import Rotation  # the command line is faster without it

    back = Rotation.from_rotvec(device.rotation_deg, degrees=True).inv()
    x, y, z = (back.apply(moved_mm) / (device.scale * MM_PER_M)).clip(-_MAX_M, _MAX_M).tolist()
    return DevicePose(stamp_ns=stamp_ns, position_m=Vector3(x=x, y=y, z=z), gripper_rad=gripper_rad, clutch=clutch)


class DeviceDoor:
    """The page's server as a device: a client of the surgeon's network that publishes poses on the hand's key.

    It connects in the background; before that poses are dropped. It also listens for another device on that key: two
    that move one hand would tear it to and fro.
    """

    def __init__(self, device: Device, endpoint: str, zenoh_options: ZenohOptions) -> None:
        self.device: Final = device
        self.error: Exception | None = None
        self._config = visitor(endpoint, zenoh_options)
        self._over = threading.Event()
        self._publisher: zenoh.Publisher | None = None
        self._foreign_s = -inf
        self._thread = threading.Thread(target=self._run, name="device", daemon=True)

    def start(self) -> None:
        """Connect in the background."""
        self._thread.start()

    def close(self) -> None:
        """Close the connection."""
        self._over.set()
        self._thread.join()

    def is_rivalled(self, within_s: float) -> bool:
        """Tell whether another device has published on the key within that time."""
        return time.monotonic() - self._foreign_s < within_s

    def publish(self, pose: DevicePose) -> bool:
        """Publish a pose; False while there is no network, or no more."""
        publisher = self._publisher
        if publisher is None:
            return False
        try:
            publisher.put(encode(pose))
        except zenoh.ZError:
            return False
        return True

    def _run(self) -> None:
        try:
            session = open_client(self._config, self._over.is_set, lambda: None)
            if session is None:
                return
            with closing(session, self._config), of_netem_only(session, self._config, "netem"):
                listening = session.declare_subscriber(
                    self.device.key, self._note_rival, allowed_origin=zenoh.Locality.REMOTE
                )
                self._publisher = publisher_of(session, self.device.key)
                self._over.wait()
                self._publisher = None
                listening.undeclare()  # type: ignore[no-untyped-call]
        except (TisError, zenoh.ZError) as error:
            self.error = error

    def _note_rival(self, _: zenoh.Sample) -> None:
        self._foreign_s = time.monotonic()
