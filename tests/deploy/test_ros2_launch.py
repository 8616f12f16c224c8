"""The launch file for ROS 2: there is no ROS here, so stand-ins of its modules load it, and its command is run."""

import runpy
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from tests.common.runtime.live_zenoh import a_client, a_router, settle, soon
from tests.docs.test_bad_network_pages import await_line, blocks
from tis.common.runtime.ports import free_endpoints

_FILE = Path(__file__).resolve().parents[2] / "deploy" / "ros2" / "netem.launch.py"
_NAMES = {
    "launch": ("LaunchContext", "LaunchDescription"),
    "launch.actions": ("DeclareLaunchArgument", "ExecuteProcess", "OpaqueFunction"),
    "launch.substitutions": ("EnvironmentVariable", "LaunchConfiguration"),
    "launch_ros": (),
    "launch_ros.actions": ("Node",),
}


class _StandIn(SimpleNamespace):
    """What a class of ROS 2 was called with."""

    def perform(self, context: Mapping[str, str]) -> str:
        return context[self.words[0]]


def _stand_in(kind: str) -> Any:
    return lambda *words, **options: _StandIn(kind=kind, words=words, **options)


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return what the file declares, and the function that starts the rest."""
    for module, names in _NAMES.items():
        stand_in = ModuleType(module)
        for name in names:
            setattr(stand_in, name, _stand_in(name))
        monkeypatch.setitem(sys.modules, module, stand_in)
    description = runpy.run_path(str(_FILE))["generate_launch_description"]()
    return list(description.words[0])


class Launch:
    """The arguments that a launch was given, and what the file makes of them."""

    def __init__(self, launched: list[Any], **given: str) -> None:
        *declared, late = launched
        values = {one.words[0]: one.default_value for one in declared}
        assert given.keys() <= values.keys()
        values = {name: one if isinstance(one, str) else one.default_value for name, one in values.items()}
        self._started = late.function({**values, **given})

    @property
    def netem(self) -> list[str]:
        (process,) = (one for one in self._started if one.kind == "ExecuteProcess")
        return list(process.cmd)

    @property
    def routers(self) -> list[Mapping[str, str]]:
        nodes = [one for one in self._started if one.kind == "Node"]
        assert {(node.package, node.executable) for node in nodes} <= {("rmw_zenoh_cpp", "rmw_zenohd")}
        return [node.additional_env for node in nodes]


def test_netem_stands_for_the_routers_of_both_sides(launched: list[Any]) -> None:
    launch = Launch(launched, profile="lte_netfi", east_port="7500", domain="3")
    said = " ".join(launch.netem)
    assert said == ("tis netem --west tcp/127.0.0.1:7447 --east tcp/127.0.0.1:7500 --profile lte_netfi --seed 0 3/**")
    assert launch.routers == []


def test_a_network_of_ones_own_a_log_and_options_are_passed_on(launched: list[Any]) -> None:
    more = "--set 'forward.delay={kind: constant, delay_ms: 50}' --duration-s 60"
    launch = Launch(launched, network="my_network.yaml", log="runs/bad", options=more)
    own = ["--scenario-network", "my_network.yaml", "--seed", "0", "--run-dir", "runs/bad"]
    options = ["--set", "forward.delay={kind: constant, delay_ms: 50}", "--duration-s", "60"]
    assert launch.netem[6:] == [*own, *options, "0/**"]
    assert Launch(launched).netem[6:] == ["--profile", "wifi_bad", "--seed", "0", "0/**"]


def test_with_routers_each_side_has_one_and_netem_joins_them(launched: list[Any]) -> None:
    launch = Launch(launched, routers="true")
    ends = [f"tcp/127.0.0.1:{port}" for port in (7447, 7448)]
    assert launch.routers == [{"ZENOH_CONFIG_OVERRIDE": f'listen/endpoints=["{end}"]'} for end in ends]
    assert launch.netem[2:6] == ["--connect-west", ends[0], "--connect-east", ends[1]]


@pytest.mark.live
def test_its_command_joins_two_routers_until_the_launch_interrupts_it(launched: list[Any]) -> None:
    west, east = free_endpoints()
    ports = {f"{side}_port": end.rpartition(":")[2] for side, end in (("west", west), ("east", east))}
    words = Launch(launched, routers="true", **ports).netem
    with a_router(west), a_router(east):
        command = [sys.executable, "-m", "tis.deploy.cli.main", *words[1:]]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as netem:
            try:
                await_line(netem, "netem: running")
                heard: list[str] = []
                with a_client(west) as talker, a_client(east) as listener:
                    _held = listener.declare_subscriber("0/chatter/**", lambda s: heard.append(str(s.key_expr)))
                    settle(listener)
                    publisher = talker.declare_publisher("0/chatter/std_msgs::msg::dds_::String_/RIHS01_1")
                    assert soon(lambda: publisher.put("hello") or bool(heard))
                netem.send_signal(2)
                assert netem.wait(60) == 0
            finally:
                netem.kill()


def test_the_page_gives_it_what_it_takes(launched: list[Any]) -> None:
    declared = {one.words[0] for one in launched if one.kind == "DeclareLaunchArgument"}
    page = "\n".join(blocks("ros2.md", "sh") + blocks("ros2.md", "python"))
    named = {word.partition(":=")[0] for word in page.split() if ":=" in word}
    assert named
    assert named <= declared
