"""`ros2 run mbd_sim example_teleop`: efforts from the keyboard of a terminal, or from a joystick on `joy`."""

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

from mbd_sim.examples.control_node import AT_START, NEWEST, end, run

RATE = 20.0  # commands a second: often enough for the simulator's watchdog
HELP = "1-9 joint   a d (or arrows) less, more   space none   q end"
ARROWS = {"\x1b[D": "a", "\x1b[C": "d"}


class Hands:
    """What the keys and sticks ask for: an effort in N or N·m for each joint, and which joint the keys move.

    `pushed` are the joints that were ever pushed.
    """

    def __init__(self, step: float) -> None:
        self.step = step
        self.efforts: dict[str, float] = {}
        self.pushed: set[str] = set()
        self.chosen = 0
        self.ended = False

    def knows(self, names: Sequence[str]) -> None:
        """Hear of the joints."""
        for name in names:
            self.efforts.setdefault(name, 0.0)

    def key(self, key: str) -> None:
        """Take a key."""
        names = list(self.efforts)
        if key == "q":
            self.ended = True
        elif key.isdigit() and 0 < int(key) <= len(names):
            self.chosen = int(key) - 1
        elif key in ("a", "d") and names:
            self.pushed.add(names[self.chosen])
            self.efforts[names[self.chosen]] += self.step if key == "d" else -self.step
        elif key == " ":
            self.efforts = dict.fromkeys(names, 0.0)

    def stick(self, axes: Sequence[float], largest: float) -> None:
        """Take a joystick: an axis for each joint, ±1 for ± the `largest` effort."""
        for name, value in zip(self.efforts, axes, strict=False):
            self.efforts[name] = value * largest
            if value:
                self.pushed.add(name)

    def line(self) -> str:
        """What is on, for the terminal."""
        shown = [
            f"{'>' if place == self.chosen else ' '}{name} {effort:+.2f}"
            for place, (name, effort) in enumerate(self.efforts.items())
        ]
        return "  ".join(shown) or "waiting for joint_states"


class TeleopNode(Node):  # type: ignore[misc]  # rclpy carries no types
    """Learns the joints from `joint_states`; efforts go out by name.

    After its end the simulator's watchdog sets them to zero.
    """

    def __init__(self) -> None:
        super().__init__("teleop")
        self.declare_parameter("effort_step", 0.5, AT_START)
        self.declare_parameter("joy_effort", 5.0, AT_START)
        self.hands = Hands(float(self.get_parameter("effort_step").value))
        self._commands = self.create_publisher(JointState, "joint_commands", 10)
        self.create_subscription(JointState, "joint_states", lambda state: self.hands.knows(state.name), NEWEST)
        largest = float(self.get_parameter("joy_effort").value)
        self.create_subscription(Joy, "joy", lambda joy: self.hands.stick(joy.axes, largest), NEWEST)
        self.create_timer(1.0 / RATE, self._send)
        print(HELP, flush=True)
        threading.Thread(target=self._listen, name="keyboard").start()  # is waited for: it sets the terminal right

    def _send(self) -> None:
        # Driven joints are in joint_states as well, but take no efforts, and a message that names one is rejected
        # whole: therefore a message for each joint, and none for joints that were never pushed.
        for name, effort in list(self.hands.efforts.items()):
            if name in self.hands.pushed:
                self._commands.publish(JointState(name=[name], effort=[effort]))
        if self.hands.ended:
            end()

    def _listen(self) -> None:
        for key in keys(sys.stdin.fileno()):
            self.hands.key(key)
            print(f"\r{self.hands.line()}   ", end="" if sys.stdin.isatty() else "\n", flush=True)


def keys(source: int) -> Iterator[str]:
    """Keys from a file descriptor, one by one, until it is closed; a terminal gives them without Enter."""
    with _one_by_one(source):
        while rclpy.ok():
            if not select.select([source], [], [], 0.2)[0]:
                continue
            if not (read := os.read(source, 64).decode(errors="ignore")):
                return
            for arrow, key in ARROWS.items():
                read = read.replace(arrow, key)
            yield from read


@contextlib.contextmanager
def _one_by_one(source: int) -> Iterator[None]:
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
    return run(TeleopNode)


if __name__ == "__main__":
    sys.exit(main())
