"""`ros2 run mbd_sim example_teleop`: sends efforts from the keyboard of a terminal, or from a joystick on `joy`."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading
from collections.abc import Iterator, Sequence

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState, Joy

from mbd_sim.examples.control_node import NEWEST, declare, end_program, run
from mbd_sim.ros.node_parameters import ParameterSpec

TOPICS = (
    ("joint_states", "sensor_msgs/msg/JointState, subscribed: the names of the joints"),
    ("joy", "sensor_msgs/msg/Joy, subscribed: a joystick"),
    ("joint_commands", "sensor_msgs/msg/JointState, published: efforts by joint name"),
)

COMMAND_RATE = 20.0  # Hz, often enough for the simulator's watchdog
HELP = "1-9 joint   a d (or arrows) less, more   space zero   q quit"
ARROWS = {"\x1b[D": "a", "\x1b[C": "d"}


class ManualEfforts:
    """Efforts in N or N·m, one for each joint, set by keys and joystick axes.

    `commanded` holds the joints that have ever had an effort.
    """

    def __init__(self, step: float) -> None:
        """`step` is the change of an effort by one key press."""
        self.step = step
        self.efforts: dict[str, float] = {}
        self.commanded: set[str] = set()
        self.selected = 0
        self.ended = False

    def add_joints(self, names: Sequence[str]) -> None:
        """Add the joints that are not known yet."""
        for name in names:
            self.efforts.setdefault(name, 0.0)

    def press(self, key: str) -> None:
        """Handle a key."""
        names = list(self.efforts)
        if key == "q":
            self.ended = True
        elif key.isdigit() and 0 < int(key) <= len(names):
            self.selected = int(key) - 1
        elif key in ("a", "d") and names:
            self.commanded.add(names[self.selected])
            self.efforts[names[self.selected]] += self.step if key == "d" else -self.step
        elif key == " ":
            self.efforts = dict.fromkeys(names, 0.0)

    def move_axes(self, axes: Sequence[float], max_effort: float) -> None:
        """Handle a joystick: one axis for each joint, where ±1 stands for ±`max_effort`."""
        for name, value in zip(self.efforts, axes, strict=False):
            self.efforts[name] = value * max_effort
            if value:
                self.commanded.add(name)

    def status_line(self) -> str:
        """The efforts, for the terminal."""
        entries = [
            f"{'>' if index == self.selected else ' '}{name} {effort:+.2f}"
            for index, (name, effort) in enumerate(self.efforts.items())
        ]
        return "  ".join(entries) or "waiting for joint_states"


class TeleopNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Publishes efforts by joint name; the joints' names come from `joint_states`.

    After its end the simulator's watchdog sets the efforts to zero.
    """

    PARAMETERS = (
        ParameterSpec("effort_step", 0.5, "change in effort per key press, in N or N·m"),
        ParameterSpec("joy_effort", 5.0, "effort at the full deflection of a joystick's axis, in N or N·m"),
    )

    def __init__(self) -> None:
        super().__init__("teleop")
        declare(self, self.PARAMETERS)
        self.manual = ManualEfforts(float(self.get_parameter("effort_step").value))
        self._commands = self.create_publisher(JointState, "joint_commands", 10)

    def start(self) -> None:
        """Subscribe, and read the keyboard."""
        max_effort = float(self.get_parameter("joy_effort").value)
        self.create_subscription(JointState, "joint_states", lambda state: self.manual.add_joints(state.name), NEWEST)
        self.create_subscription(Joy, "joy", lambda joy: self.manual.move_axes(joy.axes, max_effort), NEWEST)
        self.create_timer(1.0 / COMMAND_RATE, self._publish)
        print(HELP, flush=True)
        # Not a daemon: the program waits for this thread, which restores the terminal.
        threading.Thread(target=self._read_keys, name="keyboard").start()

    def stop(self) -> None:
        """Nothing to release."""

    def _publish(self) -> None:
        # One message for each joint, and none for joints without an effort: joint_states also contains driven
        # joints, and a message that names one of those is rejected as a whole.
        for name, effort in list(self.manual.efforts.items()):
            if name in self.manual.commanded:
                self._commands.publish(JointState(name=[name], effort=[effort]))
        if self.manual.ended:
            end_program()

    def _read_keys(self) -> None:
        for key in keys(sys.stdin.fileno()):
            self.manual.press(key)
            print(f"\r{self.manual.status_line()}   ", end="" if sys.stdin.isatty() else "\n", flush=True)


def keys(source: int) -> Iterator[str]:
    """Single keys from a file descriptor until it is closed; a terminal delivers them without Enter."""
    with _unbuffered_terminal(source):
        while rclpy.ok():
            if not select.select([source], [], [], 0.2)[0]:
                continue
            if not (text := os.read(source, 64).decode(errors="ignore")):
                return
            for arrow, key in ARROWS.items():
                text = text.replace(arrow, key)
            yield from text


@contextlib.contextmanager
def _unbuffered_terminal(source: int) -> Iterator[None]:
    if not os.isatty(source):
        yield
        return
    import termios
    import tty

    before = termios.tcgetattr(source)
    tty.setcbreak(source)
    try:
        yield
    finally:
        termios.tcsetattr(source, termios.TCSADRAIN, before)


def main() -> int:
    """Run the node."""
    return run("example_teleop", TeleopNode, example="effort_step:=0.5", topics=TOPICS)


if __name__ == "__main__":
    sys.exit(main())
