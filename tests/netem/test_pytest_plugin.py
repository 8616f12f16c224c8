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


def test_a_project_of_its_own_gets_a_network_and_the_proof(tmp_path: Path) -> None:
    (tmp_path / "test_robot.py").write_text(_TEST)
    words = ["-q", "-p", "no:cacheprovider", "--tis-netem-dir", "proofs", "--junit-xml", "junit.xml"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    command = [sys.executable, "-m", "pytest", *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment, check=False)
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
