"""A short run of both hands, made once, and MCAP files as other people write them."""

import contextlib
import io
import os
from pathlib import Path

import pytest
from mcap.writer import Writer
from rich.console import Console

from tis.common.errors import EXIT_OK
from tis.common.scenario import Scenario
from tis.deploy.run.conclude import Ending, Outputs, conclude
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    return resolve("default", ["source.hands=[left, right]", "patient.plant={kind: servo}"], None, 5.0)


@pytest.fixture(scope="session")
def run_dir(of_all_workers: Path, scenario: Scenario) -> Path:
    """A twin with all its files but the report, the same for all workers; not to be changed."""
    return _twin(of_all_workers / "both_hands", scenario)


@pytest.fixture(scope="session")
def touch_dir(of_all_workers: Path) -> Path:
    """A twin that touches a wall and sees it, likewise."""
    slow = ["rate_hz=100", "identification.train_samples=400", "touch.environment.distance_mm=-5", "sight={}"]
    return _twin(of_all_workers / "touch", resolve("touch", slow, None, 1.0))


def _twin(whole: Path, scenario: Scenario) -> Path:
    if whole.exists():
        return whole
    path = folder.create(whole.with_name(f"{whole.name}.{os.getpid()}"), scenario)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, path)
    quiet = Console(file=io.StringIO())
    conclude(path, scenario, Ending("twin", "tis twin default", EXIT_OK, {}), quiet, Outputs(report=False))
    with contextlib.suppress(OSError):  # another worker's came first, and is the same
        path.rename(whole)
    return whole


def write_ros2(path: Path, compressed: bool = True) -> None:
    """A file as ROS 2 writes it: CDR payloads, schemas as text, times since 1970, an attachment."""
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=compressed)
        writer.start(profile="ros2", library="somebody's recorder 1.2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/chatter", "cdr", schema, {"offered_qos_profiles": ""})
        for k in range(100):
            at_ns = 1_700_000_000_000_000_000 + k * 10_000_000
            writer.add_message(channel, at_ns, b"\x00\x01\x00\x00" + bytes([k]), at_ns, k)
        writer.add_metadata("rosbag2", {"version": "9"})
        writer.add_attachment(0, 0, "notes.txt", "text/plain", b"hello")
        writer.finish()  # type: ignore[no-untyped-call]
