"""Play a recording: `ros2 launch mbd_sim replay.launch.py bag:=RUN.mcap rate:=2.0 loop:=true`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

ARGUMENTS = [
    ("rate", "1.0", "1: as recorded; 0: as fast as possible", float),
    ("start", "0.0", "where to start, in s after the first message", float),
    ("end", "0.0", "where to end, in s after the first message; 0: at the recording's end", float),
    ("loop", "false", "restart at the end", bool),
    ("stay", "false", "pause at the end instead of exiting", bool),
    ("start_paused", "false", "wait for ~/pause, ~/step or ~/seek", bool),
    ("clock_rate", "200.0", "/clock messages per recorded second", float),
]


def generate_launch_description():
    """The node with its parameters as launch arguments."""
    parameters = {name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, _, _, kind in ARGUMENTS}
    parameters["bag"] = ParameterValue(LaunchConfiguration("bag"), value_type=str)
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="the recording: an .mcap or .db3 file, or a rosbag2 folder"),
            *(
                DeclareLaunchArgument(name, default_value=default, description=about)
                for name, default, about, _ in ARGUMENTS
            ),
            Node(
                package="mbd_sim",
                executable="replay_node",
                name="replay_node",
                output="screen",
                parameters=[parameters],
            ),
        ]
    )
