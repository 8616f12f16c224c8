"""A bad network between ROS 2 nodes with rmw_zenoh: to include, or `ros2 launch netem.launch.py profile:=wifi_bad`.

netem listens for both sides in place of an rmw_zenohd, or with ``routers:=true`` joins two of them, which it starts.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "profile": ("wifi_bad", "Network: a name of `tis net profiles`, or a profile's file."),
    "west_port": ("7447", "Port of the nodes in the west."),
    "east_port": ("7448", "Port of the nodes in the east."),
    "domain": (EnvironmentVariable("ROS_DOMAIN_ID", default_value="0"), "ROS domain, which crosses with its graph."),
    "seed": ("0", "Decides every random number."),
    "routers": ("false", "Start an rmw_zenohd on both ports, and let netem connect to them."),
}


def generate_launch_description() -> LaunchDescription:
    """Return netem, and with ``routers`` a router on each side."""
    ends = {side: ["tcp/127.0.0.1:", LaunchConfiguration(f"{side}_port")] for side in ("west", "east")}
    rest = ["--profile", LaunchConfiguration("profile"), "--seed", LaunchConfiguration("seed")]
    rest.append([LaunchConfiguration("domain"), "/**"])
    routers = LaunchConfiguration("routers")
    alone, joining = (
        ExecuteProcess(
            cmd=["tis", "netem", west, ends["west"], east, ends["east"], *rest], output="screen", condition=condition
        )
        for west, east, condition in (
            ("--west", "--east", UnlessCondition(routers)),
            ("--connect-west", "--connect-east", IfCondition(routers)),
        )
    )
    started = [
        Node(
            package="rmw_zenoh_cpp",
            executable="rmw_zenohd",
            additional_env={"ZENOH_CONFIG_OVERRIDE": ['listen/endpoints=["', *end, '"]']},
            condition=IfCondition(routers),
        )
        for end in ends.values()
    ]
    declared = [DeclareLaunchArgument(name, default_value=value, description=text)
                for name, (value, text) in ARGUMENTS.items()]  # fmt: skip
    return LaunchDescription([*declared, *started, alone, joining])
