import subprocess
import sys
from collections.abc import Mapping

import pytest

from tis.common.channels import Network
from tis.common.errors import InputError
from tis.netem.bridge.carrying import Ends, ends_of
from tis.netem.bridge.sides import Place
from tis.netem.bridge.standalone import Carriage


def _ends(**places: tuple[str, str]) -> Ends:
    return _ends_of("tcp", places)


def _ends_of(carry: Carriage, places: Mapping[str, tuple[str, str]]) -> Ends:
    made: dict[Network, Place] = {}
    for network, (listen, connect) in places.items():
        made["west" if network == "west" else "east"] = Place(tuple(listen.split()), tuple(connect.split()))
    return ends_of(made, carry)


def test_one_network_listens_and_the_other_is_called() -> None:
    found = _ends(west=("tcp/127.0.0.1:7448", ""), east=("", "tls/robot.example:7447#a=b"))
    assert found == Ends(("127.0.0.1", 7448), ("robot.example", 7447), "west")
    found = _ends(west=("", "tcp/[::1]:1"), east=("tcp/[::]:2", ""))
    assert found == Ends(("::", 2), ("::1", 1), "east")


@pytest.mark.parametrize(
    "places",
    [
        {"west": ("tcp/h:1", ""), "east": ("tcp/h:2", "")},
        {"west": ("", "tcp/h:1"), "east": ("", "tcp/h:2")},
        {"west": ("tcp/h:1", "tcp/h:3"), "east": ("", "")},
        {"west": ("tcp/h:1 tcp/h:3", ""), "east": ("", "tcp/h:2")},
    ],
)
def test_other_places_are_refused(places: dict[str, tuple[str, str]]) -> None:
    with pytest.raises(InputError, match="must be --west and --connect-east, or --east and --connect-west"):
        _ends(**places)


def test_other_protocols_are_refused_together() -> None:
    with pytest.raises(InputError) as error:
        _ends(west=("udp/h:1", ""), east=("", "quic/h:2"))
    assert [(fault.field, fault.got) for fault in error.value.faults] == [
        ("--west", "udp/h:1"), ("--connect-east", "quic/h:2"),
    ]  # fmt: skip
    assert _ends_of("udp", {"west": ("udp/h:1", ""), "east": ("", "quic/h:2")}) == Ends(("h", 1), ("h", 2), "west")
    with pytest.raises(InputError, match="--connect-east: must read udp/HOST:PORT or quic/HOST:PORT"):
        _ends_of("udp", {"west": ("udp/h:1", ""), "east": ("", "tcp/h:2")})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--carry", "tcp", "--west", "tcp/0.0.0.0:1"], "netem: --west: must be on loopback with --carry"),
        (["--carry", "sctp"], "netem: --carry: must be messages, tcp, udp (got 'sctp')"),
        (["--carry", "udp"], "netem: --west: must read udp/HOST:PORT or quic/HOST:PORT with --carry udp"),
        (["--control", "tcp/127.0.0.1:1"], "netem: --control: needs --carry tcp"),
        (["--carry", "tcp", "--control", "nonsense"], "netem: --control: must be PROTOCOL/ADDRESS"),
        (["--carry", "tcp", "demo/**"], "netem: KEYEXPR: must not be given with --carry tcp"),
        (["--carry", "tcp", "--set", "forward.loss.p_loss=0.1"], "netem: forward.loss: needs recovery"),
    ],
)
def test_faults_of_the_command_line_are_told(words: list[str], said: str) -> None:
    west = [] if "--west" in words else ["--west", "tcp/127.0.0.1:1"]
    places = [*west, "--connect-east", "tcp/127.0.0.1:2"]
    done = subprocess.run(
        [sys.executable, "-m", "tis.deploy.cli.main", "netem", *places, *words],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,  # one that is not refused would run on
    )
    assert (done.returncode, said in " ".join(done.stderr.split())) == (2, True), done.stderr
