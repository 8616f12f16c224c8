"""A bad network between ROS 2 nodes with rmw_zenoh: to include, or `ros2 launch netem.launch.py profile:=wifi_bad`.

netem listens for both sides in place of an rmw_zenohd, or with ``routers:=true`` joins two of them, which it starts.
"""

import shlex
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "profile": ("", "Network: a name of `tis net profiles`, or a profile's file; wifi_bad without either."),
    "network": ("", "Network: a file with one, or a scenario, as of `tis netem --scenario-network`."),
    "log": ("", "Folder for a log of every packet; none is written without."),
    "options": ("", "More options of `tis netem`, as in a shell, like '--set forward.loss.p_loss=0.01'."),
    "west_port": ("7447", "Port of the nodes in the west."),
    "east_port": ("7448", "Port of the nodes in the east."),
    "domain": (EnvironmentVariable("ROS_DOMAIN_ID", default_value="0"), "ROS domain, which crosses with its graph."),
    "seed": ("0", "Decides every random number."),
    "routers": ("false", "Start an rmw_zenohd on both ports, and let netem connect to them."),
}


def generate_launch_description() -> LaunchDescription:
    """Return netem, and with ``routers`` a router on each side."""
    declared = [DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in ARGUMENTS.items()]  # fmt: skip
    return LaunchDescription([*declared, OpaqueFunction(function=_started)])


def _started(context: LaunchContext) -> list[Any]:
    """Return what the arguments of this launch start."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    joins = given["routers"].lower() in ("true", "1")  # as IfCondition reads it
    ends = {side: f"tcp/127.0.0.1:{given[f'{side}_port']}" for side in ("west", "east")}
    command = ["tis", "netem"]
    for side, end in ends.items():
        command += [f"--connect-{side}" if joins else f"--{side}", end]
    chosen = {"--profile": given["profile"], "--scenario-network": given["network"]}
    chosen = {option: value for option, value in chosen.items() if value} or {"--profile": "wifi_bad"}
    for option, value in {**chosen, "--seed": given["seed"], "--run-dir": given["log"]}.items():
        command += [option, value] if value else []
    command += [*shlex.split(given["options"]), f"{given['domain']}/**"]
    routers = [
        Node(
            package="rmw_zenoh_cpp",
            executable="rmw_zenohd",
            additional_env={"ZENOH_CONFIG_OVERRIDE": f'listen/endpoints=["{end}"]'},
        )
        for end in ends.values()
    ]
    return [*(routers if joins else []), ExecuteProcess(cmd=command, output="screen")]
