"""`ros2 run mbd_sim example_teleop`: sends commands from the keyboard of a terminal, or from a joystick on `joy`."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator, Sequence

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState, Joy

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.examples.control_node import NEWEST, declare, end_program, run
from mbd_sim.ros.node.parameters import ParameterSpec

TOPICS = (
    ("joint_states", "sensor_msgs/msg/JointState, subscribed: the names of the joints"),
    ("joy", "sensor_msgs/msg/Joy, subscribed: a joystick"),
    ("joint_commands", "sensor_msgs/msg/JointState, published: efforts, velocities or positions by joint name"),
)

KINDS = ("effort", "velocity", "position")
COMMAND_RATE = 20.0  # Hz, often enough for the simulator's watchdog
HELP = "1-9 joint   a d (or arrows) less, more   space zero (positions: hold)   q quit"
ARROWS = {"\x1b[D": "a", "\x1b[C": "d"}


class ManualCommands:
    """A command for each joint, in the units of `kind`, set by keys and joystick axes.

    `commanded` holds the joints that have ever had a command. A position is commanded from where its joint is.
    """

    def __init__(self, kind: str, step: float) -> None:
        """`step` is the change of a command by one key press."""
        self.kind, self.step = kind, step
        self.values: dict[str, float] = {}
        self.positions: dict[str, float] = {}
        self.commanded: set[str] = set()
        self.selected = 0
        self.ended = False

    def take_state(self, names: Sequence[str], positions: Sequence[float]) -> None:
        """Add the joints that are not known yet, and note where all of them are."""
        self.positions = dict(zip(names, positions, strict=True))
        for name in names:
            self.values.setdefault(name, 0.0)
            if name not in self.commanded:
                self.values[name] = self._neutral(name)

    def press(self, key: str) -> None:
        """Handle a key."""
        names = list(self.values)
        if key == "q":
            self.ended = True
        elif key.isdigit() and 0 < int(key) <= len(names):
            self.selected = int(key) - 1
        elif key in ("a", "d") and names:
            self.commanded.add(names[self.selected])
            self.values[names[self.selected]] += self.step if key == "d" else -self.step
        elif key == " ":
            self.values = {name: self._neutral(name) for name in names}

    def move_axes(self, axes: Sequence[float], full: float) -> None:
        """Handle a joystick: one axis for each joint, where ±1 stands for ±`full`."""
        for name, value in zip(self.values, axes, strict=False):
            if value:
                self.commanded.add(name)
            if name in self.commanded:
                self.values[name] = value * full

    def status_line(self) -> str:
        """The commands, for the terminal."""
        entries = [
            f"{'>' if index == self.selected else ' '}{name} {value:+.2f}"
            for index, (name, value) in enumerate(self.values.items())
        ]
        return "  ".join(entries) or "waiting for joint_states"

    def _neutral(self, name: str) -> float:
        """The command with which a joint is left alone: none of effort and velocity, and the position where it is."""
        return self.positions.get(name, 0.0) if self.kind == "position" else 0.0


class TeleopNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Publishes commands by joint name; the joints' names come from `joint_states`.

    After its end the simulator's watchdog sets efforts to zero, and with `actuator_timeout` velocities as well.
    """

    PARAMETERS = (
        ParameterSpec("command", "effort", "what is commanded: effort, velocity or position; see joint_commands"),
        ParameterSpec("effort_step", 0.5, "change in effort per key press, in N or N·m"),
        ParameterSpec("joy_effort", 5.0, "effort at the full deflection of a joystick's axis, in N or N·m"),
        ParameterSpec("velocity_step", 0.2, "change in velocity per key press, in m/s or rad/s"),
        ParameterSpec("joy_velocity", 1.0, "velocity at the full deflection of a joystick's axis, in m/s or rad/s"),
        ParameterSpec("position_step", 0.05, "change in position per key press, in m or rad"),
        ParameterSpec("joy_position", 0.5, "position at the full deflection of a joystick's axis, in m or rad"),
    )

    def __init__(self) -> None:
        super().__init__("teleop")
        declare(self, self.PARAMETERS)
        kind = str(self.get_parameter("command").value)
        if kind not in KINDS:
            raise InputError(f"command: there is no command '{kind}'", nearest(kind, KINDS))
        self.manual = ManualCommands(kind, float(self.get_parameter(f"{kind}_step").value))
        self._commands = self.create_publisher(JointState, "joint_commands", 10)

    def start(self) -> None:
        """Subscribe, and read the keyboard."""
        full = float(self.get_parameter(f"joy_{self.manual.kind}").value)
        self.create_subscription(JointState, "joint_states", self._take_state, NEWEST)
        self.create_subscription(Joy, "joy", lambda joy: self.manual.move_axes(joy.axes, full), NEWEST)
        self.create_timer(1.0 / COMMAND_RATE, self._publish)
        print(HELP, flush=True)
        # Not a daemon: the program waits for this thread, which restores the terminal.
        threading.Thread(target=self._read_keys, name="keyboard").start()

    def stop(self) -> None:
        """Nothing to release."""

    def _take_state(self, state: JointState) -> None:
        self.manual.take_state(state.name, state.position)

    def _publish(self) -> None:
        # One message for each joint, and none for joints without a command: joint_states also contains joints that
        # take none, and a message that names one of those is rejected as a whole.
        for name, value in list(self.manual.values.items()):
            if name in self.manual.commanded:
                self._commands.publish(JointState(name=[name], **{self.manual.kind: [value]}))
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
