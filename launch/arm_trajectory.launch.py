"""An arm with servos follows a trajectory: `ros2 launch mbd_sim arm_trajectory.launch.py rerun:=spawn`."""

from launch.actions import IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

SIM = {"mechanism": "six_axis_servo_arm"}


def generate_launch_description():
    """The simulator, with all arguments of sim.launch.py, and the program that sends trajectories."""
    sim = PathJoinSubstitution([FindPackageShare("mbd_sim"), "launch", "sim.launch.py"])
    return LaunchDescription(
        [
            IncludeLaunchDescription(sim, launch_arguments=SIM.items()),
            Node(package="mbd_sim", executable="example_arm_trajectory", output="screen"),
        ]
    )
