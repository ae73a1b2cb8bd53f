"""Run a mechanism: `ros2 launch mbd_sim sim.launch.py mechanism:=rod_pendulum rerun:=spawn rviz:=true`."""

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = [
    ("mechanism", "double_rod", "a mechanism file, or the name of a mechanism that ships"),
    ("publish_rate", "100.0", "joint states per simulated second"),
    ("real_time_factor", "1.0", "1: real time; 0: as fast as possible"),
    ("start_paused", "false", "wait for ~/pause or ~/step"),
    ("record", "true", "record the run to an MCAP file"),
    ("record_dir", "recordings", "folder of the recordings"),
    ("rerun", "", "spawn, serve, connect, or a file.rrd"),
]
RVIZ = ("rviz", "false", "robot_state_publisher and RViz beside it, where they are installed")
KINDS = {"publish_rate": float, "real_time_factor": float, "start_paused": bool, "record": bool}


def generate_launch_description():
    """The node with its parameters as launch arguments, and RViz where asked for."""
    parameters = {
        name: ParameterValue(LaunchConfiguration(name), value_type=KINDS.get(name, str)) for name, _, _ in ARGUMENTS
    }
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=about)
                for name, default, about in [*ARGUMENTS, RVIZ]
            ),
            Node(package="mbd_sim", executable="sim_node", name="sim_node", output="screen", parameters=[parameters]),
            OpaqueFunction(function=rviz, condition=IfCondition(LaunchConfiguration("rviz"))),
        ]
    )


def rviz(context):
    """RViz and robot_state_publisher on simulated time; a note where they are not installed."""
    missing = [package for package in ("robot_state_publisher", "rviz2") if not installed(package)]
    if missing:
        return [LogInfo(msg=f"rviz:=true: not installed: {', '.join(missing)}")]
    config = PathJoinSubstitution([FindPackageShare("mbd_sim"), "launch", "mechanism.rviz"])
    simulated = {"use_sim_time": True}
    return [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            # The description comes from sim_node on a latched topic; the parameter must not be empty all the same.
            parameters=[simulated, {"robot_description": described(context)}],
            remappings=[("robot_description", "robot_description_of_state_publisher")],
        ),
        Node(package="rviz2", executable="rviz2", arguments=["-d", config], parameters=[simulated]),
    ]


def described(context):
    """The URDF of the mechanism, from the same file as the node's."""
    from mbd_sim.mechanism.load import load_mechanism
    from mbd_sim.mechanism.urdf import to_urdf

    return to_urdf(load_mechanism(LaunchConfiguration("mechanism").perform(context)))


def installed(package):
    """Whether a ROS package can be found."""
    try:
        get_package_share_directory(package)
    except PackageNotFoundError:
        return False
    return True
