"""Control a cart manually: `ros2 launch mbd_sim teleop.launch.py terminal:="xterm -e"`, or use a joystick."""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

SIM = {"mechanism": "cart_pendulum", "publish_rate": "100.0"}
TERMINAL = "a command that opens a terminal for the keyboard; without it, only a joystick on `joy` is read"


def generate_launch_description():
    """The simulator, with all arguments of sim.launch.py, and the node for keyboard and joystick."""
    sim = PathJoinSubstitution([FindPackageShare("mbd_sim"), "launch", "sim.launch.py"])
    terminal = LaunchConfiguration("terminal")
    return LaunchDescription(
        [
            DeclareLaunchArgument("terminal", default_value="", description=TERMINAL),
            IncludeLaunchDescription(sim, launch_arguments=SIM.items()),
            Node(package="mbd_sim", executable="example_teleop", output="screen", prefix=terminal),
        ]
    )
