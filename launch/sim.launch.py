"""Run a mechanism: `ros2 launch mbd_sim sim.launch.py mechanism:=rod_pendulum rerun:=spawn rviz:=true`."""

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

# Parameters of the node: name, default, meaning.
PARAMETERS = [
    ("mechanism", "double_rod", "a mechanism file, or the name of a shipped mechanism"),
    ("method", "", "integration method; empty: that of the mechanism's file"),
    ("step", "0.0", "integration step in s; 0: that of the mechanism's file"),
    ("publish_rate", "100.0", "joint states per simulated second"),
    ("clock_rate", "200.0", "/clock messages per simulated second; 0: none"),
    ("real_time_factor", "1.0", "1: real time; 0: as fast as possible"),
    ("start_paused", "false", "wait for ~/pause or ~/step"),
    (
        "command_timeout",
        "0.5",
        "simulated s without a command for a joint after which its effort is set to zero; 0: never",
    ),
    ("record", "true", "record the run to an MCAP file"),
    ("record_dir", "recordings", "folder of the recordings"),
    ("rerun", "", "spawn, serve, connect, or a file.rrd"),
    ("marker_rate", "30.0", "markers per simulated second, while subscribed; 0: none"),
    ("joint_reactions", "false", "publish the force and moment that each joint transmits"),
    ("constraint_violation", "false", "publish by how much loops and constraints are violated"),
    ("frame_prefix", "", "prefix of all frame names, for several instances: name/"),
]
KINDS = {
    **dict.fromkeys(
        ["step", "publish_rate", "clock_rate", "real_time_factor", "command_timeout", "marker_rate"], float
    ),
    **dict.fromkeys(["start_paused", "record", "joint_reactions", "constraint_violation"], bool),
}
OTHERS = [
    ("namespace", "", "namespace of all nodes"),
    ("params_file", "", "a YAML file of parameters, such as live values; it overrides the other arguments"),
    ("rviz", "false", "start RViz with the markers, and robot_state_publisher, if they are installed"),
]


def generate_launch_description():
    """The node with its parameters as launch arguments, and RViz on request."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=about)
                for name, default, about in [*PARAMETERS, *OTHERS]
            ),
            OpaqueFunction(function=simulation),
            OpaqueFunction(function=rviz, condition=IfCondition(LaunchConfiguration("rviz"))),
        ]
    )


def simulation(context):
    """The node; the parameter file comes last, so that it overrides the defaults of the arguments."""
    parameters = [
        {name: ParameterValue(LaunchConfiguration(name), value_type=KINDS.get(name, str)) for name, _, _ in PARAMETERS}
    ]
    if file := LaunchConfiguration("params_file").perform(context):
        parameters.append(file)
    return [
        Node(
            package="mbd_sim",
            executable="sim_node",
            name="sim_node",
            namespace=LaunchConfiguration("namespace"),
            output="screen",
            parameters=parameters,
        )
    ]


def rviz(context):
    """RViz on simulated time, which needs only the markers, and robot_state_publisher for the URDF and TF."""
    missing = [package for package in ("rviz2", "robot_state_publisher") if not installed(package)]
    found = [LogInfo(msg=f"rviz:=true: not installed: {', '.join(missing)}")] if missing else []
    simulated, namespace = {"use_sim_time": True}, LaunchConfiguration("namespace")
    prefix = {"frame_prefix": LaunchConfiguration("frame_prefix")}
    if "robot_state_publisher" not in missing:
        found.append(
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                namespace=namespace,
                # sim_node publishes the description on a latched topic, but the parameter must not be empty either.
                parameters=[simulated, prefix, {"robot_description": described(context)}],
                remappings=[("robot_description", "robot_description_of_state_publisher")],
            )
        )
    if "rviz2" not in missing:
        config = PathJoinSubstitution([FindPackageShare("mbd_sim"), "launch", "mechanism.rviz"])
        fixed = [LaunchConfiguration("frame_prefix"), "ground"]
        found.append(
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=namespace,
                arguments=["-d", config, "-f", fixed],
                parameters=[simulated],
            )
        )
    return found


def described(context):
    """The URDF of the mechanism, from the same file as the node's."""
    from mbd_sim.load import load_mechanism
    from mbd_sim.urdf.urdf_writer import to_urdf

    return to_urdf(load_mechanism(LaunchConfiguration("mechanism").perform(context)))


def installed(package):
    """Whether a ROS package can be found."""
    try:
        get_package_share_directory(package)
    except PackageNotFoundError:
        return False
    return True
