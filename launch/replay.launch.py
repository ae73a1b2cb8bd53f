"""Play a recording: `ros2 launch mbd_sim replay.launch.py bag:=RUN.mcap rate:=2.0 loop:=true`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from mbd_sim.ros.node.parameters import argument_rows
from mbd_sim.ros.replay.replay_node import PARAMETERS

ARGUMENTS = [row for row in argument_rows(PARAMETERS) if row[0] != "bag"]  # name, default, meaning, type


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
