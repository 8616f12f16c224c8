"""ROS 2 over netem and in a run, with zenoh-ros2-sdk as the ROS 2 side: there is no ROS here."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.system.conftest import RunHere, StartHere, is_right_but_for_the_machine
from tests.system.ros2_side import N_EACH, TOPICS
from tests.system.test_transparent import Netem

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(find_spec("zenoh_ros2_sdk") is None, reason="zenoh-ros2-sdk is not installed"),
]
_ESTIMATORS = "estimators=[hold, innovations_kf]"
_ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def a_side(role: str, endpoint: str) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, "-m", "tests.system.ros2_side", role, endpoint.rpartition(":")[2]]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, cwd=_ROOT, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    with process:
        try:
            yield process
        finally:
            process.kill()


def test_poses_twists_joint_states_and_a_service_cross_netem(endpoints: tuple[str, str]) -> None:
    west_end, east_end = endpoints
    netem = Netem(
        "--west", west_end, "--east", east_end, "--set", "forward.delay={kind: constant, delay_ms: 30}", "0/**"
    )
    with ExitStack() as stack:
        stack.callback(netem.process.kill)
        netem.await_running()
        east = stack.enter_context(a_side("east", east_end))
        assert east.stdout is not None
        assert east.stdout.readline() == "ready\n"
        west = stack.enter_context(a_side("west", west_end))
        said, err = west.communicate(timeout=60)
        assert said, err
        assert json.loads(said) == [42, -(2**40) + 1]
        said, err = east.communicate(timeout=60)  # ends its standard input
        found = json.loads(said)
        netem.end()
    assert found["served"] == 2
    assert found["got"] == {topic: [float(i) for i in range(N_EACH)] for topic in TOPICS}


def test_a_pose_stamped_of_ros_2_is_a_device_that_the_estimators_follow(
    run_here: StartHere, endpoints: tuple[str, str]
) -> None:
    def move(run: RunHere) -> None:
        run.await_log("netem", 1)
        with a_side("device", west):
            while run.is_under_way():
                time.sleep(0.05)

    west, east = endpoints
    source = "source={kind: live, encoding: ros2, keys: {left: 0/device/left/*/*}}"
    hosts = f"hosts={{west: {west}, east: {east}}}"
    settings = [word for text in (source, hosts, _ESTIMATORS) for word in ("--set", text)]
    tis = run_here("run", "live", "--duration-s", "5", *settings, meanwhile=move)
    code, _, err = tis.wait()
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    row = summary["devices"]["left"]
    assert row["poses"] > 100
    assert set(row["refused"].values()) == {0}
    assert summary["accuracy"]["innovations_kf"]["n_scored"] > 30
    assert summary["links"]["forward"]["dropped_by"].get("refused", 0) == 0  # it stays on its network
