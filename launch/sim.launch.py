"""Run a mechanism: `ros2 launch mbd_sim sim.launch.py mechanism:=rod_pendulum rerun:=spawn rviz:=true`."""

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from mbd_sim.ros.node.parameters import argument_rows
from mbd_sim.ros.node.sim_parameters import PARAMETERS

ARGUMENTS = argument_rows(PARAMETERS)  # all parameters of the node: name, default, meaning, type
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
                for name, default, about in [*(row[:3] for row in ARGUMENTS), *OTHERS]
            ),
            OpaqueFunction(function=simulation),
            OpaqueFunction(function=rviz, condition=IfCondition(LaunchConfiguration("rviz"))),
        ]
    )


def simulation(context):
    """The node; the parameter file comes last, so that it overrides the defaults of the arguments."""
    parameters = [{name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, _, _, kind in ARGUMENTS}]
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
    from mbd_sim.files.load import load_mechanism
    from mbd_sim.files.urdf.writer import to_urdf

    base = LaunchConfiguration("base").perform(context)
    return to_urdf(load_mechanism(LaunchConfiguration("mechanism").perform(context), base or None))


def installed(package):
    """Whether a ROS package can be found."""
    try:
        get_package_share_directory(package)
    except PackageNotFoundError:
        return False
    return True
