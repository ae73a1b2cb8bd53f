"""`ros2 run mbd_sim example_imu_balance`: balances a pendulum by an inertial sensor, a complementary filter and LQR."""

from __future__ import annotations

import math
import sys
import time

import numpy as np
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import SetBool

from mbd_sim.analysis.linear.linearization import linearize
from mbd_sim.analysis.linear.state_space import lqr
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.equations import derive
from mbd_sim.examples.control_node import ControlNode, mechanism_parameter, run
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.ros.node.parameters import ParameterSpec

STATE_COST, EFFORT_COST = np.diag([4.0, 20.0, 2.0, 1.0]), np.array([[0.1]])  # of x, angle and their rates; of the force
FILTER_TIME = 1.0  # s: below 1/FILTER_TIME in rad/s the tilt is that of gravity, above that of the rate gyro
SPEED_TIME = 0.02  # s of the low-pass filter for the speed of the cart
FALLEN = math.radians(50.0)
START_PERIOD = 0.2  # s of real time between looks for a simulator to start
ATTEMPT_PERIOD = 5.0  # s of real time between attempts to start it; in lockstep each takes steps
TOPICS = (
    ("sim_node/sensors/imu", "sensor_msgs/msg/Imu, subscribed: each message is answered with a force"),
    ("sim_node/sensors/wheel", "sensor_msgs/msg/JointState, subscribed: the position of the cart"),
    ("joint_commands", "sensor_msgs/msg/JointState, published: the force on the cart"),
)


class TiltFilter:
    """The tilt of a pendulum in rad from its angular velocity and specific force, without the drift of the rate gyro.

    A complementary filter: the integrated angular velocity follows the direction of the specific force slowly, and the
    bias of the rate gyro is what this correction needs on average (Mahony, Hamel & Pflimlin 2008, for one axis).
    """

    def __init__(self, filter_time: float = FILTER_TIME) -> None:
        self._gain = 2.0 / filter_time  # with that of the bias, both poles are at 1/filter_time
        self._bias_gain = 1.0 / filter_time**2
        self.tilt, self.bias, self._time = 0.0, 0.0, math.nan

    def update(self, time: float, rate: float, forward: float, upward: float) -> float:
        """The tilt at a time in s, from the angular velocity in rad/s and the specific force in m/s²."""
        leaning = math.atan2(-forward, upward)
        if math.isnan(self._time):
            self.tilt = leaning
        else:
            period, deviation = time - self._time, leaning - self.tilt
            self.bias -= self._bias_gain * deviation * period
            self.tilt += (rate - self.bias + self._gain * deviation) * period
        self._time = time
        return self.tilt


class Balance:
    """The force on the cart of a mechanism with the coordinates (cart, pendulum), which is upright at zero."""

    def __init__(self, mechanism: Mechanism, filter_time: float = FILTER_TIME) -> None:
        equations, zeros = derive(mechanism), np.zeros(2)
        linear = linearize(equations, zeros, zeros, zeros)
        self._of_state, self._of_force = linear.a[2], float(linear.b[2, 0])  # acceleration of the cart
        self.gain: Array = lqr(linear.a, linear.b[:, :1], STATE_COST, EFFORT_COST)[0]
        self.effort_limit = float(mechanism.effort_limits()[0])
        self.filter = TiltFilter(filter_time)
        self._position, self._speed, self._time = 0.0, 0.0, math.nan
        self._acceleration = 0.0  # of the cart in m/s², as the equations give it

    @property
    def has_fallen(self) -> bool:
        """Whether the pendulum is too far from upright to be caught."""
        return abs(self.filter.tilt) > FALLEN

    def measure_cart(self, time: float, position: float) -> None:
        """Take a position of the cart in m, and estimate its speed."""
        if time > self._time:
            period = time - self._time
            slope = (position - self._position) / period
            self._speed += (slope - self._speed) * period / (period + SPEED_TIME)
        self._position, self._time = position, time

    def force(self, time: float, rate: float, forward: float, upward: float) -> float:
        """The force in N, from the angular velocity about y in rad/s and the specific force along x and z in m/s².

        The specific force contains the acceleration of the cart, which would be taken for a tilt: the filter gets the
        rest of it.
        """
        tilt = self.filter.update(time, rate, forward - self._acceleration, upward)
        if self.has_fallen:
            return 0.0
        state = np.array([self._position, tilt, self._speed, rate - self.filter.bias])
        force = float(np.clip(-self.gain @ state, -self.effort_limit, self.effort_limit))
        self._acceleration = float(self._of_state @ state) + self._of_force * force
        return force


class ImuBalanceNode(ControlNode):
    """Answers each message of the inertial sensor; the simulator may wait for it, paused, at the start."""

    PARAMETERS = (
        mechanism_parameter("balancing_pendulum"),
        ParameterSpec("resume", True, "resume the simulator, which waits paused, when the controller is ready"),
        ParameterSpec("filter_time", FILTER_TIME, "time constant of the complementary filter in s", 0.01, 100.0),
    )

    def __init__(self) -> None:
        super().__init__("imu_balance")
        self.law = Balance(self.mechanism, self.get_parameter("filter_time").value)
        self._measured, self._attempted = False, -math.inf

    def start(self) -> None:
        """Subscribe to the sensors, and start the simulator."""
        self.create_subscription(JointState, "sim_node/sensors/wheel", self._on_cart, 10)
        # Reliable: a measurement that is lost in lockstep would be waited for forever.
        self._imu = self.create_subscription(Imu, "sim_node/sensors/imu", self._on_imu, 10)
        self._pause = self.create_client(SetBool, "sim_node/pause")
        self._starting = self.create_timer(START_PERIOD, self._begin)
        self.get_logger().info(f"balancing '{self.mechanism.name}'")

    def _begin(self) -> None:
        """Let the simulator run until the first measurement arrives: a command triggers steps in lockstep."""
        if self._measured:
            self._starting.cancel()
            return
        connected = self._imu.get_publisher_count() and self._commands.get_subscription_count()
        if not connected or time.monotonic() < self._attempted + ATTEMPT_PERIOD:
            return
        if self.get_parameter("resume").value:
            if not self._pause.service_is_ready():
                return
            self._pause.call_async(SetBool.Request(data=False))
        self._attempted = time.monotonic()
        self._send(0.0)

    def _on_cart(self, message: JointState) -> None:
        self.law.measure_cart(_seconds(message), message.position[0])

    def _on_imu(self, message: Imu) -> None:
        self._measured, had_fallen = True, self.law.has_fallen
        forward, upward = message.linear_acceleration.x, message.linear_acceleration.z
        self._send(self.law.force(_seconds(message), message.angular_velocity.y, forward, upward))
        if self.law.has_fallen and not had_fallen:
            self.get_logger().warning("the pendulum has fallen: pause the simulator, reset it, and start again")

    def _send(self, force: float) -> None:
        self._commands.publish(JointState(name=self.names[:1], effort=[force]))


def _seconds(message: Imu | JointState) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def main() -> int:
    """Run the node."""
    return run("example_imu_balance", ImuBalanceNode, example="mechanism:=balancing_pendulum", topics=TOPICS)


if __name__ == "__main__":
    sys.exit(main())
