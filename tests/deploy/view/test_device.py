import math

import pytest

from tests.nodes import an_arrival
from tis.common.messages import encode
from tis.common.scenario import Scenario
from tis.common.units import sample_instant_ns
from tis.deploy.run.resolve import resolve
from tis.deploy.view.device import device_of, device_pose
from tis.surgeon_side.live import LiveMotion


def _live(*settings: str) -> Scenario:
    return resolve("drive", settings)


@pytest.mark.parametrize(
    "settings", [(), ("source.scale=2.5",), ("source.rotation_deg=[10, -80, 35]", "source.scale=0.2")]
)
def test_the_source_commands_the_arm_exactly_as_far_as_the_page_moved(settings: tuple[str, ...]) -> None:
    scenario = _live(*settings)
    device, source = device_of(scenario), scenario.source
    assert device is not None
    assert source.kind == "live"
    motion, places = LiveMotion(source, 30), []
    for k, moved_mm in enumerate([(0.0, 0.0, 0.0), (4.0, -3.0, 2.0)]):
        pose = device_pose(device, moved_mm, 0.7, clutch=False, stamp_ns=k)
        t_ns = sample_instant_ns(k, 30)
        motion.take(an_arrival(device.key, t_ns, b"", encode(pose), "west"))
        motion.advance(k, t_ns)
        places.append(motion.poses(k)[0].arm)
    moved = [1e3 * (b - a) for a, b in zip(places[0].position_m, places[1].position_m, strict=True)]
    assert moved == pytest.approx([4.0, -3.0, 2.0], abs=1e-9)
    assert places[1].gripper_rad == 0.7


def test_the_clutch_moves_the_hand_and_not_the_arm() -> None:
    device = device_of(_live())
    assert device is not None
    pose = device_pose(device, (1.0, 0.0, 0.0), 0.0, clutch=True, stamp_ns=5)
    assert (pose.clutch, pose.stamp_ns, pose.position_m.x) == (True, 5, 0.002)


def test_only_a_live_source_in_json_has_a_device_and_it_is_the_first_hands() -> None:
    assert device_of(resolve("default")) is None
    assert device_of(_live("source.encoding=ros2")) is None
    device = device_of(_live("source.hands=[right, left]"))
    assert device is not None
    assert (device.hand, device.arm, device.key) == ("right", "PSM1", "device/MTMR/measured_cp")


def test_a_hand_that_was_moved_far_by_many_pages_stays_a_pose() -> None:
    device = device_of(_live())
    assert device is not None
    pose = device_pose(device, (1e12, 0.0, 0.0), 0.0, clutch=False, stamp_ns=0)
    assert pose.position_m.x == 100.0
    assert math.isfinite(pose.position_m.y)
