"""The fixture of the pytest plugin, used from a project of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.live
_TEST = """
import json, time, zenoh

def a_session(endpoint):
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    return zenoh.open(config)

def test_without_a_network():
    import sys
    assert "tis.netem.bridge" not in sys.modules

def test_a_robot_hears(tis_netem):
    west, east = net = tis_netem(settings=["forward.loss={kind: bernoulli, p_loss: 1}"], seed=3)
    net.outage(0.05)
    time.sleep(0.1)
    with a_session(west) as one, a_session(east) as other:
        heard = []
        held = other.declare_subscriber("a/b", heard.append)
        publisher = one.declare_publisher("a/b")
        while not publisher.matching_status.matching:
            time.sleep(0.05)
        publisher.put("x")
        time.sleep(0.3)
    assert heard, "nothing came through"
"""
_OF_ALL_TESTS = """
import time, pytest
from test_robot import a_session

@pytest.fixture(scope="session")
def robot(tis_netem_shared):
    west, east = tis_netem_shared(seed=3)
    with a_session(east) as session:
        heard = []
        held = session.declare_subscriber("a/b", heard.append)
        yield heard

@pytest.fixture
def operator(tis_netem):
    net = tis_netem(seed=3, shared=True)
    with a_session(net.west) as session:
        publisher = session.declare_publisher("a/b")
        while not publisher.matching_status.matching:
            time.sleep(0.05)
        yield net, publisher

def sent(net, publisher, n):
    for _ in range(n):
        publisher.put("x")
    while net.counts()["forward"]["offered"] < n:
        time.sleep(0.01)

def test_in_an_outage(robot, operator):
    operator[0].outage(60)
    sent(*operator, 3)
    assert not robot
    assert False, "as asked for"

def test_after_it(robot, operator):
    net, publisher = operator
    assert net.counts()["forward"]["offered"] == 0
    net.profile("transatlantic_fiber")
    sent(net, publisher, 5)
    while net.counts()["forward"]["released"] < 5:
        time.sleep(0.01)
    assert net.counts()["forward"]["dropped.outage"] == 0
"""

_BYPASSED = """
import json, time, zenoh, pytest

def a_bypass(net):
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps([net.west, net.east]))
    with zenoh.open(config):
        until_s = time.monotonic() + 30
        while not net.n_bypasses() and time.monotonic() < until_s:
            time.sleep(0.05)

def test_own(tis_netem):
    a_bypass(tis_netem())

def test_own_on_purpose(tis_netem):
    a_bypass(tis_netem(may_bypass=True))

def test_of_all(tis_netem):
    a_bypass(tis_netem(shared=True))

def test_of_all_later(tis_netem):
    assert tis_netem(shared=True).n_bypasses()
"""


def _pytest(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tis-netem-dir", "proofs", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env=environment, check=False)


def test_a_project_of_its_own_gets_a_network_and_the_proof(tmp_path: Path) -> None:
    (tmp_path / "test_robot.py").write_text(_TEST)
    done = _pytest(tmp_path, "--junit-xml", "junit.xml")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "1 failed, 1 passed" in done.stdout
    assert "nothing came through" in done.stdout
    assert "1 messages offered, 1 dropped (loss 1)" in done.stdout
    assert "asked for while it ran: both directions, from " in done.stdout
    assert " for 0.05 s: outage" in done.stdout
    (summary,) = (tmp_path / "proofs").glob("*/netem_1/summary.json")
    assert json.loads(summary.read_text())["links"]["forward"]["dropped_by"]["loss"] == 1
    assert (
        str(Path("proofs") / "test_robot.py__test_a_robot_hears" / "netem_1") in (tmp_path / "junit.xml").read_text()
    )


def test_tests_share_a_network_and_each_has_its_own_conditions_and_counts(tmp_path: Path) -> None:
    (tmp_path / "test_robot.py").write_text(_TEST)
    (tmp_path / "test_shared.py").write_text(_OF_ALL_TESTS)
    done = _pytest(tmp_path, "test_shared.py")
    assert "1 failed, 1 passed" in done.stdout, done.stdout + done.stderr
    assert "forward: 3 messages offered, 3 dropped (outage 3)" in done.stdout
    (summary,) = (tmp_path / "proofs").glob("**/summary.json")  # one network for both
    assert json.loads(summary.read_text())["links"]["forward"]["offered"] == 8


def test_a_network_that_programs_bypass_fails_the_test_unless_it_says_otherwise(tmp_path: Path) -> None:
    (tmp_path / "test_bypassed.py").write_text(_BYPASSED)
    done = _pytest(tmp_path, "-rpE")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "4 passed, 2 errors" in done.stdout, done.stdout + done.stderr
    failed = [line.partition(" - ")[0] for line in done.stdout.splitlines() if line.startswith("ERROR ")]
    assert failed == ["ERROR test_bypassed.py::test_own", "ERROR test_bypassed.py::test_of_all"]
    assert done.stdout.count("is connected to both networks: what it sends reaches both past netem") >= 2
    assert "let programs be clients (mode: client)" in done.stdout
    assert "may_bypass=True" in done.stdout
