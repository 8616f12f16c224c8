"""A bad network for a program's own tests: real messages cross it, and it proves what it did."""

import subprocess
import sys
from pathlib import Path

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, settle, soon
from tis.common.errors import InputError
from tis.netem.bridge.between import between

pytestmark = pytest.mark.live


def test_messages_cross_it_until_an_outage_and_it_counts_them(tmp_path: Path) -> None:
    with between(settings=["forward.delay={kind: constant, delay_ms: 5}"], seed=3, run_dir=tmp_path / "run") as net:
        west, east = net
        assert net.summary == {}
        with a_client(west) as one, a_client(east) as other:
            heard: list[zenoh.Sample] = []
            _held = other.declare_subscriber("demo/key", heard.append)
            settle(other)
            publisher = one.declare_publisher("demo/key")
            assert soon(lambda: publisher.matching_status.matching)  # type: ignore[attr-defined]
            for k in range(20):
                publisher.put(f"{k}")
            assert soon(lambda: len(heard) == 20)
            net.outage(60)
            net.change({"add_delay_ms": 3}, "forward", for_s=60)
            publisher.put("lost")
            settle(one)  # it has reached netem
            net.reset()
            publisher.put("last")
            assert soon(lambda: len(heard) == 21)
            with pytest.raises(InputError, match=r"netem: set: change.delay.delay_ms: must be at least 0"):
                net.change({"delay": {"kind": "constant", "delay_ms": -1}})
    forward = net.summary["links"]["forward"]
    assert (forward["offered"], forward["dropped_by"]["outage"], forward["released"]) == (22, 1, 21)
    assert set(net.faithful) == {"forward", "feedback"}
    assert {path.name for path in net.run_dir.iterdir()} >= {"netem.mcap", "network.yaml", "summary.json"}


_PROGRAM = """\
import sys, time
from tis.netem.bridge.between import between
with between(run_dir=sys.argv[1]) as net:
    print(net.west, flush=True)
    time.sleep(60)
"""


def test_nothing_is_left_of_it_when_its_program_is_killed(tmp_path: Path) -> None:
    run_dir = tmp_path / "run"

    def left() -> int:
        """Return how many processes name the folder, but for the program itself."""
        commands = [content_of(path) for path in Path("/proc").glob("[0-9]*/cmdline")]
        return sum(str(run_dir) in command and _PROGRAM not in command for command in commands)

    with subprocess.Popen([sys.executable, "-c", _PROGRAM, str(run_dir)], stdout=subprocess.PIPE) as program:
        assert program.stdout is not None
        assert program.stdout.readline().startswith(b"tcp/")
        assert left() == 1
        program.kill()
    assert soon(lambda: left() == 0)
    assert (run_dir / "manifest.json").is_file()  # it ended in order


def content_of(path: Path) -> str:
    try:
        return path.read_text().replace("\0", " ")
    except OSError:  # the process has ended meanwhile
        return ""


@pytest.mark.parametrize(
    ("arguments", "says"),
    [({"profile": "wifi_sad"}, "wifi_sad"), ({"settings": ["forward.los.p_loss=1"]}, "forward.los")],
)
def test_a_network_that_is_none_is_refused_by_name(arguments: dict[str, str], says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says), between(**arguments, run_dir=tmp_path / "run"):  # type: ignore[arg-type]
        pass
    assert not (tmp_path / "run").exists()
