"""Level control of a hydraulic scissor lift: `ros2 launch mbd_sim hydraulic_lift.launch.py rerun:=spawn`."""

from launch.actions import IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

SIM = {"mechanism": "hydraulic_scissor_lift", "publish_rate": "100.0"}


def generate_launch_description():
    """The simulator, with all arguments of sim.launch.py, and the controller."""
    sim = PathJoinSubstitution([FindPackageShare("mbd_sim"), "launch", "sim.launch.py"])
    return LaunchDescription(
        [
            IncludeLaunchDescription(sim, launch_arguments=SIM.items()),
            Node(package="mbd_sim", executable="example_hydraulic_lift", output="screen"),
        ]
    )
