import pytest

from tests.nodes import an_arrival
from tis.deploy.run.resolve import resolve
from tis.netem.build import build_netem, staying_keys


@pytest.mark.parametrize("key", ["device/MTML/measured_cp", "tis/PSM2/servo_cp", "tis/PSM2/arm/measured_cp"])
def test_devices_set_points_and_arms_stay_on_their_network_and_out_of_the_books(key: str) -> None:
    scenario = resolve("live")
    assert key in staying_keys(scenario)
    netem = build_netem(scenario)
    for network in ("west", "east"):
        assert list(netem.receive(an_arrival(key, 5, b"", b"x", network))) == []
    assert not any(n for name, n in netem.counters().items() if "offered" in name or "dropped" in name)


def test_the_runs_own_streams_cross() -> None:
    for key in ("tis/MTML/measured_cp", "tis/PSM2/setpoint_cp", "device/other"):
        assert key not in staying_keys(resolve("live"))


def test_a_ros_topic_stays_whatever_its_type_hash() -> None:
    source = "source={kind: live, encoding: ros2, keys: {left: 0/device/left/*/*}}"
    keys = staying_keys(resolve("live", [source]))
    assert "0/device/left/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_0123" in keys
    assert "0/other/x/y" not in keys
