"""A node that does nothing but answer: the least time of a request over DDS from Python, for benchmarks/lockstep.py.

It answers each `Float64MultiArray` on `bare/commands` by a `JointState` of the same size on `bare/joint_states`, and
the service `bare/step`, with rclpy alone and the executor of `sim_node`, in a process of its own.
"""

from __future__ import annotations

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger


def main() -> None:
    """Answer until the process is interrupted."""
    rclpy.init()
    node = rclpy.create_node("bare")
    states = node.create_publisher(JointState, "bare/joint_states", 10)
    count = 0

    def on_command(message: Float64MultiArray) -> None:
        nonlocal count
        count += 1
        state = JointState(name=[f"joint_{index}" for index in range(len(message.data))], position=message.data)
        state.header.stamp.sec = count
        states.publish(state)

    node.create_subscription(Float64MultiArray, "bare/commands", on_command, 10)
    node.create_service(Trigger, "bare/step", lambda _, response: response)
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.1)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
